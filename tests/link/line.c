/* Runs an emulated robot on what came over its line: parameters, then all bytes; writes what it sends back. */
#include <stdio.h>

#include "emulated_robot.h"

int main(void)
{
    static struct ballbot_parameters parameters;
    static struct emulated_robot robot;
    uint8_t byte;
    uint8_t sent[EMULATED_ROOM];

    if (fread(&parameters, sizeof parameters, 1, stdin) != 1 || !emulated_robot_start(&robot, &parameters, 0, 0u)) {
        return 1;
    }
    while (fread(&byte, 1, 1, stdin) == 1) {
        emulated_robot_put(&robot, &byte, 1);
        const size_t count = emulated_robot_take(&robot, sent, sizeof sent);

        if (fwrite(sent, 1, count, stdout) != count) {
            return 1;
        }
    }
    return 0;
}

/* Sizes of the link and of a robot on the emulated processor. */
#include "robot.h"

uint32_t size_of_link(void);
uint32_t size_of_robot(void);

uint32_t size_of_link(void)
{
    return (uint32_t)sizeof(struct ballbot_link);
}

uint32_t size_of_robot(void)
{
    return (uint32_t)sizeof(struct robot);
}

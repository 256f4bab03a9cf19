// The main loop without an operating system, as a sketch for Arduino; on another board the same functions in C.
//
// A sample that comes too late stops the robot, with the reason "late". If the loop hangs, the last torques stay: let the board's
// watchdog disable the drivers. The host arms over the link (`ballbot run`), and the robot obeys it in robot_step. For buttons of
// the robot's own call robot_test, robot_arm and robot_disarm between two samples, and ballbot_link_confirm if arming from another
// computer needs a button here.
extern "C" {
#include <ballbot_hardware.h>
#include <ballbot_parameters.h>
#include <robot.h>

// To be written for the board: these read nothing and drive nothing.
bool ballbot_read_imu(float gyro[3], float attitude[3]) { return false; }
bool ballbot_read_encoders(int32_t counts[BALLBOT_MAX_WHEELS]) { return false; }
void ballbot_set_torques(const float torques[BALLBOT_MAX_WHEELS]) {}
void ballbot_set_enable(bool enabled) {}
uint32_t ballbot_read_time(void) { return micros(); }
void ballbot_send(const uint8_t *bytes, size_t count) {
  if (Serial.availableForWrite() >= (int)count) Serial.write(bytes, count);
}
size_t ballbot_receive(uint8_t *bytes, size_t most) {
  size_t count = 0;
  while (count < most && Serial.available()) bytes[count++] = Serial.read();
  return count;
}
}

// Return a number that is another one at each start: count up a word of EEPROM, or a register that a reset leaves as it is. With the
// same number, and a gyro that gives the same bits, what was recorded on the link before a reset would be obeyed after it.
uint32_t count_starts() { return 0; }

static struct robot robot;
static uint32_t next_sample;

void setup() {
  Serial.begin(921600);
  if (!robot_start(&robot, &ballbot_parameters, 0, count_starts())) {
    while (true) {}
  }
  next_sample = micros();
}

void loop() {
  if ((int32_t)(micros() - next_sample) < 0) return;
  next_sample += (uint32_t)(1e6f * ballbot_parameters.sample_time + 0.5f);
  robot_step(&robot);
}

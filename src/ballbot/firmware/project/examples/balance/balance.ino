// A main loop for Arduino: the seven functions of ballbot_hardware.h, to be filled in for the board, and a step every sample.
// A step that comes too late stops the robot, with the reason "late".
extern "C" {
#include <ballbot_hardware.h>
#include <ballbot_parameters.h>
#include <robot.h>

bool ballbot_read_imu(float gyro[3], float attitude[3]) { return false; }
bool ballbot_read_encoders(int32_t counts[BALLBOT_MAX_WHEELS]) { return false; }
uint32_t ballbot_read_time(void) { return micros(); }
void ballbot_set_torques(const float torques[BALLBOT_MAX_WHEELS]) {}
void ballbot_set_enable(bool enabled) {}
void ballbot_send(const uint8_t *bytes, size_t count) { Serial.write(bytes, count); }
size_t ballbot_receive(uint8_t *bytes, size_t most) {
  size_t count = 0;
  while (count < most && Serial.available()) bytes[count++] = Serial.read();
  return count;
}
}

static struct robot robot;
static uint32_t next;

void setup() {
  Serial.begin(1000000);
  // the last number must be another one at each start, such as a counter in EEPROM (link/link.h)
  robot_start(&robot, &ballbot_parameters, 0, 1);
  next = micros();
}

void loop() {
  if ((int32_t)(micros() - next) < 0) return;
  next += (uint32_t)(1e6f * ballbot_parameters.sample_time + 0.5f);
  robot_step(&robot);
}

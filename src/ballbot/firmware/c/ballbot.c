#include "ballbot.h"

#include <stddef.h>

#include "ballbot_math.h"
#include "estimation/heading.h"
#include "estimation/kalman.h"
#include "estimation/known.h"
#include "estimation/onboard.h"
#include "imu_check.h"
#include "law.h"
#include "parts/policy.h"

/* Lean from which no robot recovers [rad]. With a larger limit the robot is held: it does not balance, and the IMU's axes are not
 * checked. */
#define LARGEST_LEAN 1.2f

int32_t ballbot_refused(const struct ballbot_parameters *parameters)
{
    static const int32_t words[] = BALLBOT_SCHEMA_WORDS;
    const bool kept[BALLBOT_BOUNDS] = BALLBOT_BOUNDS_KEPT(parameters);

    for (size_t k = 0; k < sizeof words / sizeof words[0]; ++k) {
        if (words[k] != parameters->schema[k]) {
            return (int32_t)BALLBOT_REFUSED_SCHEMA;
        }
    }
    for (int32_t k = 0; k < BALLBOT_BOUNDS; ++k) {
        if (!kept[k]) {
            return (int32_t)BALLBOT_REFUSED_BOUND + k;
        }
    }
    return (int32_t)(ballbot_policy_is_known(&parameters->law.policy, parameters->wheel_count) ? BALLBOT_REFUSED_NOT :
                                                                                                 BALLBOT_REFUSED_POLICY);
}

bool ballbot_are_allowed(const struct ballbot_parameters *parameters)
{
    return ballbot_refused(parameters) == (int32_t)BALLBOT_REFUSED_NOT;
}

/* Fill a struct of numbers with zeros. */
static void clear(void *numbers, size_t size)
{
    unsigned char *bytes = (unsigned char *)numbers;

    for (size_t k = 0; k < size; ++k) {
        bytes[k] = 0u;
    }
}

bool ballbot_init(struct ballbot_state *state, const struct ballbot_parameters *parameters)
{
    static const float origin[2] = { 0.0f, 0.0f };

    clear(state, sizeof *state);
    ballbot_onboard_reset(&state->onboard, origin);
    ballbot_kalman_reset(&state->kalman, origin);
    state->run.known = (ballbot_refused(parameters) == (int32_t)BALLBOT_REFUSED_NOT) ? 1 : 0;
    state->imu_check.passed = (parameters->safety.lean > LARGEST_LEAN) ? 2 : 0;
    return state->run.known != 0;
}

void ballbot_start_self_test(struct ballbot_state *state)
{
    state->run.armed = 0;
    ballbot_safety_reset(&state->safety);
    ballbot_self_test_start(&state->self_test);
    if (state->imu_check.passed == 0) {
        ballbot_imu_check_start(&state->imu_check);
        state->self_test.result = BALLBOT_TEST_HOLD_UPRIGHT;
    }
}

/* Return whether the check of the IMU's axes waits for a position. */
static bool is_checking_imu(const struct ballbot_state *state)
{
    return state->self_test.result >= (int32_t)BALLBOT_TEST_HOLD_UPRIGHT &&
           state->self_test.result <= (int32_t)BALLBOT_TEST_TURN_LEFT;
}

/* Take a sample of the check of the IMU's axes. */
static void check_imu(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                      const struct ballbot_reading_record *reading)
{
    /* by the stage; those between two movements are upright */
    static const enum ballbot_self_test results[] = {
        BALLBOT_TEST_HOLD_UPRIGHT, BALLBOT_TEST_HOLD_UPRIGHT, BALLBOT_TEST_TILT_FORWARD, BALLBOT_TEST_HOLD_UPRIGHT,
        BALLBOT_TEST_TILT_LEFT,    BALLBOT_TEST_HOLD_UPRIGHT, BALLBOT_TEST_TURN_LEFT,    BALLBOT_TEST_IMU_PASSED,
        BALLBOT_TEST_IMU_AXES,     BALLBOT_TEST_IMU_GYRO,
    };
    struct ballbot_imu_check_state *check = &state->imu_check;
    const int32_t movement = (check->stage + 1) / 2;

    ballbot_imu_check_step(check, parameters->sample_time, reading->gyro, reading->attitude);
    const enum ballbot_self_test result = results[check->stage];
    state->self_test.result = (int32_t)result;
    state->self_test.wheel = (result == BALLBOT_TEST_IMU_PASSED) ? 0 : movement;
}

enum ballbot_self_test ballbot_self_test_of(const struct ballbot_state *state)
{
    return (enum ballbot_self_test)state->self_test.result;
}

void ballbot_skip_self_test(struct ballbot_state *state)
{
    state->self_test.result = BALLBOT_TEST_PASSED;
    ballbot_skip_imu_check(state);
}

void ballbot_skip_imu_check(struct ballbot_state *state)
{
    state->imu_check.passed = 1;
}

bool ballbot_arm(struct ballbot_state *state)
{
    if (state->run.known == 0 || state->self_test.result != BALLBOT_TEST_PASSED) {
        return false;
    }
    ballbot_safety_reset(&state->safety);
    clear(&state->memory, sizeof state->memory);
    for (int i = 0; i < 10; ++i) {
        state->run.reference[i] = 0.0f;
    }
    state->run.held = 0;
    state->run.armed = 1;
    return true;
}

void ballbot_disarm(struct ballbot_state *state)
{
    state->run.armed = 0;
    if (state->self_test.result == BALLBOT_TEST_RUNNING || is_checking_imu(state)) {
        state->self_test.result = BALLBOT_TEST_STOPPED;
    }
}

bool ballbot_is_active(const struct ballbot_state *state)
{
    const bool armed = state->run.armed != 0 && state->safety.stop == BALLBOT_STOP_NONE;

    return state->run.known != 0 && (armed || state->self_test.result == BALLBOT_TEST_RUNNING);
}

void ballbot_halt(struct ballbot_state *state, enum ballbot_stop reason)
{
    if (ballbot_is_active(state)) {
        ballbot_safety_latch(&state->safety, reason, 0);
    }
}

/* Fill the estimate; return whether the sensors gave all that it needs. */
static bool estimate(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                     const struct ballbot_reading_record *reading)
{
    const int32_t n = parameters->wheel_count;
    float *found = state->run.estimate;

    if (parameters->estimator == BALLBOT_KALMAN) {
        return ballbot_kalman_update(&parameters->kalman, &state->kalman, n, reading, found) != 0;
    }
    return ballbot_onboard_update(&parameters->onboard, &state->onboard, n, reading, found) != 0;
}

/* Return whether the safety layer allows torques from this sample. */
static bool admitted(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                     const struct ballbot_reading_record *reading, float interval, bool measured)
{
    const float imu[BALLBOT_IMU_VALUES] = { reading->gyro[0],     reading->gyro[1],     reading->gyro[2],
                                            reading->attitude[0], reading->attitude[1], reading->attitude[2] };
    const float *found = state->run.estimate;

    /* the self-test itself finds a wheel that does not turn */
    ballbot_safety_watch(&parameters->safety, &state->safety, parameters->wheel_count, imu, reading->wheel_counts,
                         state->run.armed != 0 && reading->encoders_valid != 0, state->run.torques);
    return ballbot_safety_admit(&parameters->safety, &state->safety, interval, measured, ballbot_is_state(found), found[2],
                                found[3]);
}

/* Take over a reference that is allowed; before the first one, the pose is held. */
static void take_reference(struct ballbot_state *state, const struct ballbot_law *law, const float reference[10])
{
    struct ballbot_run_state *run = &state->run;

    if (run->held == 0) {
        run->reference[0] = run->estimate[0];
        run->reference[1] = run->estimate[1];
        run->reference[4] = run->estimate[4];
        run->held = 1;
    }
    if (reference != NULL && ballbot_refused_place(law, reference) == BALLBOT_ALLOWED) {
        for (int i = 0; i < 10; ++i) {
            run->reference[i] = reference[i];
        }
    }
}

/* Fill the torques of the law; return whether the safety layer lets them pass. */
static bool balance(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                    const float reference[10], float torques[])
{
    take_reference(state, &parameters->law, reference);
    (void)ballbot_control_law(&parameters->law, &state->memory, state->run.estimate, state->run.reference, torques,
                              parameters->wheel_count);
    ballbot_safety_release(&state->safety, parameters->wheel_count, torques);
    return state->safety.stop == BALLBOT_STOP_NONE;
}

/* Fill the torques of the self-test, which the safety layer may end. */
static void test(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                 const struct ballbot_reading_record *reading, bool admitted_now, float torques[])
{
    if (!admitted_now) {
        state->self_test.result = BALLBOT_TEST_STOPPED;
    }
    ballbot_self_test_step(&state->self_test, parameters, reading, torques);
    ballbot_safety_release(&state->safety, parameters->wheel_count, torques);
}

/* Limit torques of another controller; return whether the safety layer lets them pass. */
static bool relay(struct ballbot_state *state, const struct ballbot_parameters *parameters, const float given[],
                  float torques[])
{
    for (int32_t i = 0; i < parameters->wheel_count; ++i) {
        torques[i] = ballbot_clipped(given[i], parameters->law.torque_limit);
    }
    ballbot_safety_release(&state->safety, parameters->wheel_count, torques);
    return state->safety.stop == BALLBOT_STOP_NONE;
}

/* Take one sample with the law's torques, or with those that are given. */
static bool step(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                 const struct ballbot_reading_record *reading, uint32_t time, const float reference[10],
                 const float given[], float torques[])
{
    struct ballbot_run_state *run = &state->run;
    bool may = false;

    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        torques[i] = 0.0f;
    }
    if (run->known == 0) {
        return false;
    }
    const uint32_t passed = (run->started != 0) ? time - (uint32_t)run->time : 0u;
    struct ballbot_reading_record seen = *reading;

    if (ballbot_is_known(seen.attitude[2])) {
        seen.attitude[2] = ballbot_unwrapped(&state->heading, seen.attitude[2]);
    }
    const bool measured = estimate(state, parameters, &seen);

    run->time = (int32_t)time;
    run->started = 1;
    const bool testing = run->armed == 0 && state->self_test.result == BALLBOT_TEST_RUNNING;

    if (run->armed != 0 || testing) {
        may = admitted(state, parameters, &seen, 1e-6f * (float)passed, measured);
    } else if (is_checking_imu(state)) {
        check_imu(state, parameters, &seen);
    } else {
        /* at rest */
    }
    if (testing) {
        test(state, parameters, &seen, may, torques);
    } else if (may && given != NULL) {
        may = relay(state, parameters, given, torques);
    } else if (may) {
        may = balance(state, parameters, reference, torques);
    } else {
        /* no torques */
    }
    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        run->torques[i] = torques[i];
    }
    return may;
}

bool ballbot_update(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                    const struct ballbot_reading_record *reading, uint32_t time, const float reference[10],
                    float torques[BALLBOT_MAX_WHEELS])
{
    return step(state, parameters, reading, time, reference, NULL, torques);
}

bool ballbot_relay(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                   const struct ballbot_reading_record *reading, uint32_t time, const float given[BALLBOT_MAX_WHEELS],
                   float torques[BALLBOT_MAX_WHEELS])
{
    return step(state, parameters, reading, time, NULL, given, torques);
}

enum ballbot_stop ballbot_stop_of(const struct ballbot_state *state)
{
    return (enum ballbot_stop)state->safety.stop;
}

const char *ballbot_stop_word(enum ballbot_stop stop)
{
    switch (stop) {
    case BALLBOT_STOP_MISSING:
        return "missing";
    case BALLBOT_STOP_LEAN:
        return "lean";
    case BALLBOT_STOP_TORQUE:
        return "torque";
    case BALLBOT_STOP_LATE:
        return "late";
    case BALLBOT_STOP_STUCK:
        return "stuck";
    case BALLBOT_STOP_LINK:
        return "link";
    case BALLBOT_STOP_NONE:
    default:
        return "";
    }
}

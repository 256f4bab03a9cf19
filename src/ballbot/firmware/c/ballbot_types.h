/* The records of Ballbot as structs: parameters, state and sensor readings.
 *
 * Generated from the schemas of the Python package by `python -m tests.support.firmware_headers`; do not edit.
 * Units are SI and stand behind each member; [1] is a number without a unit. Matrices are stored by rows.
 * State vectors are x, y, theta, phi, psi and their rates.
 */
#ifndef BALLBOT_TYPES_H
#define BALLBOT_TYPES_H

#include <stdint.h>

/* Wheels that a record has room for. */
#define BALLBOT_MAX_WHEELS 4
/* Updates whose torques the law remembers. */
#define BALLBOT_MAX_PAST 22
/* Gains that can be mixed. */
#define BALLBOT_MAX_GAINS 3
/* Numbers of a setting, and the place of the one after the weights of the other gains. */
#define BALLBOT_TUNING_NUMBERS BALLBOT_MAX_GAINS
#define BALLBOT_TUNING_COMPENSATION (BALLBOT_MAX_GAINS - 1)
/* Speeds of the table of a friction law. */
#define BALLBOT_TABLE_SPEEDS 32
/* SHA-256 of names, order, types, lengths and units of everything below. */
#define BALLBOT_SCHEMA_DIGEST "fe7453353908029b85109f607edf917f4824db5b8b99db9f8eaafae55b6f394a"
/* The same as 8 numbers of 31 bits, as the parameters hold it. */
#define BALLBOT_SCHEMA_WORDS { 2121552693, 956826267, 84975456, 2128580991, 1210375003, 194632607, 246086373, 1534015818 }

/* Every number below has the same width. */
typedef char ballbot_numbers_are_alike[(sizeof(float) == sizeof(int32_t)) ? 1 : -1];

/* A push of the self-test. */
struct ballbot_self_test_record {
    float torque; /* [N m] */
    int32_t ramp;
    int32_t counts;
};
typedef char ballbot_self_test_record_has_no_padding[(sizeof(struct ballbot_self_test_record) == 3u * sizeof(float)) ? 1 : -1];

/* The friction that is compensated, and the mode of compensation. */
struct ballbot_compensation_record {
    float inv_rb; /* [1/m] */
    float inv_vs; /* [s/rad] */
    float delta; /* [1] */
    float rolling; /* [N] */
    float steepness; /* [s/rad] */
    float rolling_steepness; /* [s/m] */
    float full; /* [1] */
    float partial; /* [1] */
    float axles[BALLBOT_MAX_WHEELS][3]; /* [1] */
    float viscous[BALLBOT_MAX_WHEELS]; /* [N m s/rad] */
    float coulomb[BALLBOT_MAX_WHEELS]; /* [N m] */
    float stribeck[BALLBOT_MAX_WHEELS]; /* [N m] */
    float directed; /* [1] */
    float coulomb_asymmetry[BALLBOT_MAX_WHEELS]; /* [N m] */
    float stribeck_asymmetry[BALLBOT_MAX_WHEELS]; /* [N m] */
    float load[BALLBOT_MAX_WHEELS]; /* [1] */
    float tabulated; /* [1] */
    float table_speeds[BALLBOT_TABLE_SPEEDS]; /* [rad/s] */
    float table_sizes[BALLBOT_MAX_WHEELS][BALLBOT_TABLE_SPEEDS]; /* [N m] */
    float for_rolling[BALLBOT_MAX_WHEELS][2]; /* [m] */
};
typedef char ballbot_compensation_record_has_no_padding[(sizeof(struct ballbot_compensation_record) == 214u * sizeof(float)) ? 1 : -1];

/* What may change while the robot balances: the differences of other gains from the law's own, and bounds. */
struct ballbot_tuning_record {
    int32_t others;
    float step; /* [1] */
    float compensation; /* [1] */
    float gain[2][4][10]; /* [N m per state] */
    float integral[2][4][3]; /* [N m/(m s)] */
    float asked[2][2][4]; /* [rad/m] */
    float turn_rate[2]; /* [s] */
};
typedef char ballbot_tuning_record_has_no_padding[(sizeof(struct ballbot_tuning_record) == 125u * sizeof(float)) ? 1 : -1];

/* The sampled planner. */
struct ballbot_planner_record {
    int32_t on;
    int32_t every;
    int32_t steps;
    float rate; /* [1/s] */
    float falling; /* [1/s] */
    float square; /* [s^2] */
    float ball; /* [s^2] */
    float interval[6]; /* [s] */
    float kept[6]; /* [1] */
    float early[6]; /* [1] */
    float late[6]; /* [1] */
    float inverse[BALLBOT_MAX_WHEELS][23][23]; /* [1] */
    float by_lead[BALLBOT_MAX_WHEELS][23]; /* [1] */
    float by_start[BALLBOT_MAX_WHEELS][23][4]; /* [1] */
    float by_reference[BALLBOT_MAX_WHEELS][23][3]; /* [1] */
    float frame[BALLBOT_MAX_WHEELS][2]; /* [1] */
    float rolling[BALLBOT_MAX_WHEELS][2]; /* [rad/m] */
    float most; /* [m/s^2] */
    float viscous; /* [m/(s rad)] */
    float dry; /* [m/s^2] */
    float worst; /* [1] */
    float torque; /* [1/(kg m)] */
    float weight[BALLBOT_MAX_WHEELS]; /* [1] */
    float bound[BALLBOT_MAX_WHEELS]; /* [1] */
    float change; /* [m/s^2] */
    float speed; /* [m/s] */
    float prompt; /* [m/s] */
    float far; /* [m] */
    float delay; /* [s] */
    float late_reference; /* [1] */
    float late_lost; /* [1] */
    float largest_lost; /* [m/s^2] */
    float yaw_frequency; /* [rad/s] */
    float yaw_decay; /* [1] */
    float yaw_gone; /* [1] */
    float yaw_rate; /* [rad/s] */
    float yaw_acceleration; /* [rad/s^2] */
    float yaw_prompt; /* [rad/s] */
};
typedef char ballbot_planner_record_has_no_padding[(sizeof(struct ballbot_planner_record) == 2926u * sizeof(float)) ? 1 : -1];

/* What a motion of the flat output needs, linear in its derivatives, heading frame. */
struct ballbot_feed_forward_record {
    int32_t on;
    float lean[2][2]; /* [rad s^2/m] */
    float offset[2][2]; /* [s^2] */
    float by_second[BALLBOT_MAX_WHEELS][2]; /* [N m s^2/m] */
    float by_fourth[BALLBOT_MAX_WHEELS][2]; /* [N m s^4/m] */
    float by_turning[BALLBOT_MAX_WHEELS]; /* [N m s^2/rad] */
    float pull[2][2]; /* [m/(s^2 rad)] */
    float rolling; /* [rad] */
    float rate; /* [1/s] */
    float delay; /* [s] */
};
typedef char ballbot_feed_forward_record_has_no_padding[(sizeof(struct ballbot_feed_forward_record) == 36u * sizeof(float)) ? 1 : -1];

/* The sampled integral. */
struct ballbot_integral_record {
    int32_t on;
    float step; /* [s] */
    float kept; /* [1] */
    float limit; /* [m s] */
    float yaw_limit; /* [rad s] */
    float dead_band; /* [m] */
    float gain[BALLBOT_MAX_WHEELS][3]; /* [N m/(m s)] */
};
typedef char ballbot_integral_record_has_no_padding[(sizeof(struct ballbot_integral_record) == 18u * sizeof(float)) ? 1 : -1];

/* The sampled observer, and the torques that a motion needs, heading frame. */
struct ballbot_observer_record {
    int32_t on;
    float fraction; /* [1] */
    float limit; /* [N m] */
    float by_acceleration[BALLBOT_MAX_WHEELS][5]; /* [N m s^2/m] */
    float by_lean[BALLBOT_MAX_WHEELS][2]; /* [N m/rad] */
    float idle[BALLBOT_MAX_WHEELS]; /* [1] */
};
typedef char ballbot_observer_record_has_no_padding[(sizeof(struct ballbot_observer_record) == 35u * sizeof(float)) ? 1 : -1];

/* The limits, and the lean that errors command. */
struct ballbot_lean_limit_record {
    int32_t on;
    float lean; /* [rad] */
    float asked[2][4]; /* [rad/m] */
    float turn; /* [rad] */
    float turn_rate; /* [s] */
};
typedef char ballbot_lean_limit_record_has_no_padding[(sizeof(struct ballbot_lean_limit_record) == 12u * sizeof(float)) ? 1 : -1];

/* (b_0 + b_1/z + b_2/z^2) / (1 + a_1/z + a_2/z^2). */
struct ballbot_notch_record {
    int32_t on;
    float b_0; /* [1] */
    float b_1; /* [1] */
    float b_2; /* [1] */
    float a_1; /* [1] */
    float a_2; /* [1] */
};
typedef char ballbot_notch_record_has_no_padding[(sizeof(struct ballbot_notch_record) == 6u * sizeof(float)) ? 1 : -1];

/* The numbers of the prediction, heading frame. */
struct ballbot_prediction_record {
    int32_t on;
    int32_t count;
    int32_t samples;
    float fraction; /* [1] */
    float transition[10][10]; /* [1] */
    float by_torque[BALLBOT_MAX_WHEELS][20][10]; /* [1/(N m)] */
};
typedef char ballbot_prediction_record_has_no_padding[(sizeof(struct ballbot_prediction_record) == 904u * sizeof(float)) ? 1 : -1];

/* A policy without its weights. */
struct ballbot_policy_record {
    int32_t on;
    float feedback; /* [1] */
    float torque_scale; /* [N m] */
    float torque_limit; /* [N m] */
    float largest_lean; /* [rad] */
    float largest_speed; /* [m/s] */
    float rate; /* [1/s] */
    int32_t period;
    int32_t hidden;
    int32_t wheels;
    int32_t checksum;
};
typedef char ballbot_policy_record_has_no_padding[(sizeof(struct ballbot_policy_record) == 11u * sizeof(float)) ? 1 : -1];

struct ballbot_law {
    float torque_limit; /* [N m] */
    float rate; /* [1/s] */
    float gain[BALLBOT_MAX_WHEELS][10]; /* [N m per state] */
    struct ballbot_compensation_record compensation;
    struct ballbot_tuning_record tuning;
    struct ballbot_planner_record planner;
    struct ballbot_feed_forward_record feed_forward;
    struct ballbot_integral_record integral;
    struct ballbot_observer_record disturbance_observer;
    struct ballbot_lean_limit_record lean_limit;
    struct ballbot_notch_record notch;
    struct ballbot_prediction_record prediction;
    struct ballbot_policy_record policy;
};
typedef char ballbot_law_has_no_padding[(sizeof(struct ballbot_law) == 4329u * sizeof(float)) ? 1 : -1];

/* What the safety layer lets pass. */
struct ballbot_safety_record {
    int32_t max_missing;
    float lean; /* [rad] */
    float max_interval; /* [s] */
    int32_t max_unchanged;
    float turning_torque; /* [N m] */
};
typedef char ballbot_safety_record_has_no_padding[(sizeof(struct ballbot_safety_record) == 5u * sizeof(float)) ? 1 : -1];

/* The numbers of the on-board state, the thesis's way. */
struct ballbot_onboard_record {
    float sample_time; /* [s] */
    float radius; /* [m] */
    float ball_from_wheels[3][4]; /* [1] */
};
typedef char ballbot_onboard_record_has_no_padding[(sizeof(struct ballbot_onboard_record) == 14u * sizeof(float)) ? 1 : -1];

/* The numbers of the Kalman filter. */
struct ballbot_kalman_record {
    float sample_time; /* [s] */
    float radius; /* [m] */
    float ball_turn[3][4]; /* [rad] */
    float lever[2][3]; /* [m] */
    float pull[2][2]; /* [m/s^2] */
    float rolling; /* [1] */
    float forgotten; /* [1] */
    float gyro_variance; /* [rad^2/s^2] */
    float walk[14]; /* [square of the state] */
    float variances[6]; /* [square of what is shown] */
    float start_variances[14]; /* [square of the state] */
    float start_covariances[BALLBOT_MAX_WHEELS]; /* [1, rad^2, rad^2/s^2] */
    float pivoting_share; /* [1] */
    float pivoted_share; /* [1] */
    float pivoting_variance; /* [1] */
};
typedef char ballbot_kalman_record_has_no_padding[(sizeof(struct ballbot_kalman_record) == 68u * sizeof(float)) ? 1 : -1];

/* The numbers of one controller. */
struct ballbot_parameters {
    int32_t schema[8];
    int32_t wheel_count;
    int32_t estimator;
    float sample_time; /* [s] */
    float encoder_step; /* [rad] */
    struct ballbot_self_test_record self_test;
    struct ballbot_law law;
    struct ballbot_safety_record safety;
    struct ballbot_onboard_record onboard;
    struct ballbot_kalman_record kalman;
};
typedef char ballbot_parameters_has_no_padding[(sizeof(struct ballbot_parameters) == 4431u * sizeof(float)) ? 1 : -1];

/* Whether torques are given, and the last update. */
struct ballbot_run_state {
    int32_t known;
    int32_t armed;
    int32_t held;
    int32_t started;
    int32_t time;
    float estimate[10]; /* [state] */
    float reference[10]; /* [state] */
    float torques[BALLBOT_MAX_WHEELS]; /* [N m] */
};
typedef char ballbot_run_state_has_no_padding[(sizeof(struct ballbot_run_state) == 29u * sizeof(float)) ? 1 : -1];

/* The last value of a heading that wraps around, and the whole turns since the start. */
struct ballbot_heading_memory {
    int32_t started;
    float last; /* [rad] */
    int32_t turns;
};
typedef char ballbot_heading_memory_has_no_padding[(sizeof(struct ballbot_heading_memory) == 3u * sizeof(float)) ? 1 : -1];

/* Why the torques are zero, and the last samples. */
struct ballbot_safety_state {
    int32_t stop;
    int32_t stop_wheel;
    int32_t missing;
    int32_t watched;
    float imu[6]; /* [rad/s, rad] */
    int32_t imu_unchanged;
    int32_t counts_valid;
    int32_t counts[BALLBOT_MAX_WHEELS];
    int32_t pushed[BALLBOT_MAX_WHEELS];
};
typedef char ballbot_safety_state_has_no_padding[(sizeof(struct ballbot_safety_state) == 20u * sizeof(float)) ? 1 : -1];

/* How far the self-test is, and its result. */
struct ballbot_self_test_state {
    int32_t result;
    int32_t wheel;
    int32_t pushed;
    int32_t sample;
    int32_t forward;
    int32_t counts[BALLBOT_MAX_WHEELS];
};
typedef char ballbot_self_test_state_has_no_padding[(sizeof(struct ballbot_self_test_state) == 9u * sizeof(float)) ? 1 : -1];

/* How far the check of the IMU's axes is. */
struct ballbot_imu_check_state {
    int32_t passed;
    int32_t stage;
    int32_t still;
    int32_t moved;
    float attitude_sum[3]; /* [rad] */
    float rest[3]; /* [rad] */
    float turned[BALLBOT_MAX_WHEELS]; /* [1] */
};
typedef char ballbot_imu_check_state_has_no_padding[(sizeof(struct ballbot_imu_check_state) == 14u * sizeof(float)) ? 1 : -1];

/* Each wheel's torques at the last updates, the newest first. */
struct ballbot_torque_history {
    float acting[BALLBOT_MAX_PAST][BALLBOT_MAX_WHEELS]; /* [N m] */
    float friction_compensation[BALLBOT_MAX_PAST][BALLBOT_MAX_WHEELS]; /* [N m] */
    float disturbance_compensation[BALLBOT_MAX_PAST][BALLBOT_MAX_WHEELS]; /* [N m] */
    float limited[BALLBOT_MAX_PAST][BALLBOT_MAX_WHEELS]; /* [1] */
};
typedef char ballbot_torque_history_has_no_padding[(sizeof(struct ballbot_torque_history) == 352u * sizeof(float)) ? 1 : -1];

/* Weights of the other gains, and what the compensation is reduced by; zeros: nothing. */
struct ballbot_tuning_state {
    float wanted[3]; /* [1] */
    float former[3]; /* [1] */
    float now[3]; /* [1] */
    float gain[BALLBOT_MAX_WHEELS][10]; /* [N m per state] */
    float integral[BALLBOT_MAX_WHEELS][3]; /* [N m/(m s)] */
    float asked[2][4]; /* [rad/m] */
    float turn_rate; /* [s] */
};
typedef char ballbot_tuning_state_has_no_padding[(sizeof(struct ballbot_tuning_state) == 70u * sizeof(float)) ? 1 : -1];

/* The plan, its rows and what the solver works with; places are relative to s. */
struct ballbot_planner_state {
    int32_t started;
    int32_t since;
    float place[2]; /* [m] */
    float place_rest[2]; /* [m] */
    float motion[2]; /* [m/s] */
    float lag[2]; /* [m/s^2] */
    float lead[2]; /* [m/s^2] */
    float now[2]; /* [m/s^2] */
    float a[2][24]; /* [m/s^2] */
    float t[BALLBOT_MAX_WHEELS][24][2]; /* [1] */
    float z[BALLBOT_MAX_WHEELS][24][2]; /* [1] */
    float last[2]; /* [m] */
    float reference[2]; /* [m/s] */
    float bend[2]; /* [m/s^2] */
    float lost[2]; /* [m/s^2] */
    float catching; /* [1] */
    int32_t solving;
    float begun[2][4]; /* [m] */
    float needs[2]; /* [m/s^2] */
    float moved[2]; /* [m] */
    float wall[BALLBOT_MAX_WHEELS]; /* [m] */
    float hedge; /* [1] */
    float v[24][2]; /* [m/s] */
    float y[24][2]; /* [m] */
    float free_v[24][2]; /* [m/s] */
    float free_y[24][2]; /* [m] */
    float none[24]; /* [m/s^2] */
    float start[2][23]; /* [1] */
    float pull[24]; /* [1] */
    float ahead[24]; /* [m/s^2] */
    float force_v[24]; /* [1] */
    float force_y[24]; /* [1] */
    float drag[24][2]; /* [m/s^2] */
    float radius[24]; /* [m/s^2] */
    float lags[BALLBOT_MAX_WHEELS]; /* [rad] */
    float lags_rest[BALLBOT_MAX_WHEELS]; /* [rad] */
    float turned[1]; /* [rad] */
    float turned_rest[1]; /* [rad] */
    float turning; /* [rad/s] */
    float last_psi; /* [rad] */
    float turn_change; /* [rad/s] */
    float turn_bend; /* [rad/s^2] */
};
typedef char ballbot_planner_state_has_no_padding[(sizeof(struct ballbot_planner_state) == 917u * sizeof(float)) ? 1 : -1];

/* The row of a plan that is followed: its state, for how many samples, and the change of its rates. */
struct ballbot_feed_forward_state {
    int32_t started;
    int32_t age;
    float row[10]; /* [m] */
    float changes[3]; /* [rad/s^2] */
};
typedef char ballbot_feed_forward_state_has_no_padding[(sizeof(struct ballbot_feed_forward_state) == 15u * sizeof(float)) ? 1 : -1];

/* The integrals of x, y [m s] and psi [rad s], world frame. */
struct ballbot_integral_state {
    float sums[3]; /* [m s] */
};
typedef char ballbot_integral_state_has_no_padding[(sizeof(struct ballbot_integral_state) == 3u * sizeof(float)) ? 1 : -1];

/* The rates of the last sample, whether they are known, and d, the estimate that is added. */
struct ballbot_observer_state {
    float rates[5]; /* [m/s] */
    int32_t started;
    float estimate[BALLBOT_MAX_WHEELS]; /* [N m] */
};
typedef char ballbot_observer_state_has_no_padding[(sizeof(struct ballbot_observer_state) == 10u * sizeof(float)) ? 1 : -1];

/* The state of a part without memory; compiled records have at least one field. */
struct ballbot_no_state {
    float unused; /* [1] */
};
typedef char ballbot_no_state_has_no_padding[(sizeof(struct ballbot_no_state) == 1u * sizeof(float)) ? 1 : -1];

/* Of each wheel's filter. */
struct ballbot_notch_state {
    float delayed[BALLBOT_MAX_WHEELS][2]; /* [N m] */
};
typedef char ballbot_notch_state_has_no_padding[(sizeof(struct ballbot_notch_state) == 8u * sizeof(float)) ? 1 : -1];

/* The predicted state, relative to the measured pose, and the buffers in which it is computed. */
struct ballbot_prediction_state {
    float ahead[10]; /* [1] */
    float turned[10]; /* [1] */
    float after[10]; /* [1] */
};
typedef char ballbot_prediction_state_has_no_padding[(sizeof(struct ballbot_prediction_state) == 30u * sizeof(float)) ? 1 : -1];

/* What a policy remembers from sample to sample. */
struct ballbot_policy_state {
    int32_t started;
    int32_t waited;
    float asked[3]; /* [m, m, rad] */
    float past[3][4]; /* [N m] */
};
typedef char ballbot_policy_state_has_no_padding[(sizeof(struct ballbot_policy_state) == 17u * sizeof(float)) ? 1 : -1];

struct ballbot_memory {
    struct ballbot_torque_history history;
    struct ballbot_heading_memory measured_heading;
    struct ballbot_heading_memory reference_heading;
    struct ballbot_tuning_state tuning;
    struct ballbot_planner_state planner;
    struct ballbot_feed_forward_state feed_forward;
    struct ballbot_integral_state integral;
    struct ballbot_observer_state disturbance_observer;
    struct ballbot_no_state lean_limit;
    struct ballbot_notch_state notch;
    struct ballbot_prediction_state prediction;
    struct ballbot_policy_state policy;
};
typedef char ballbot_memory_has_no_padding[(sizeof(struct ballbot_memory) == 1429u * sizeof(float)) ? 1 : -1];

/* What the on-board state remembers. */
struct ballbot_onboard_memory {
    int32_t started;
    float position[2]; /* [m] */
    float position_rest[2]; /* [m] */
    float velocity[2]; /* [m/s] */
    float gyro[3]; /* [rad/s] */
    float attitude[3]; /* [rad] */
};
typedef char ballbot_onboard_memory_has_no_padding[(sizeof(struct ballbot_onboard_memory) == 13u * sizeof(float)) ? 1 : -1];

/* What is known of slip and pushes; zeros at the start. */
struct ballbot_slip_memory {
    int32_t wheel;
    float push; /* [m/s] */
    float faster[2]; /* [m/s] */
};
typedef char ballbot_slip_memory_has_no_padding[(sizeof(struct ballbot_slip_memory) == 4u * sizeof(float)) ? 1 : -1];

/* What the Kalman filter remembers. */
struct ballbot_kalman_memory {
    int32_t started;
    int32_t missed;
    int32_t wheel_counts[BALLBOT_MAX_WHEELS];
    float gyro[3]; /* [rad/s] */
    float pivoting; /* [rad/s] */
    float pivoted; /* [rad^2/s^2] */
    float x[14]; /* [state] */
    float rest[14]; /* [state] */
    float P[14][14]; /* [product of two states] */
    struct ballbot_slip_memory slip;
};
typedef char ballbot_kalman_memory_has_no_padding[(sizeof(struct ballbot_kalman_memory) == 239u * sizeof(float)) ? 1 : -1];

/* All that changes while the robot runs. */
struct ballbot_state {
    struct ballbot_run_state run;
    struct ballbot_heading_memory heading;
    struct ballbot_safety_state safety;
    struct ballbot_self_test_state self_test;
    struct ballbot_imu_check_state imu_check;
    struct ballbot_memory memory;
    struct ballbot_onboard_memory onboard;
    struct ballbot_kalman_memory kalman;
};
typedef char ballbot_state_has_no_padding[(sizeof(struct ballbot_state) == 1756u * sizeof(float)) ? 1 : -1];

/* The readings of all sensors at one instant; a value that is missing is NaN. */
struct ballbot_reading_record {
    int32_t encoders_valid;
    int32_t wheel_counts[BALLBOT_MAX_WHEELS];
    float wheel_speeds[BALLBOT_MAX_WHEELS]; /* [rad/s] */
    float gyro[3]; /* [rad/s] */
    float attitude[3]; /* [rad] */
    float fix_position[2]; /* [m] */
    float fix_heading; /* [rad] */
    float fix_position_deviation; /* [m] */
    float fix_heading_deviation; /* [rad] */
};
typedef char ballbot_reading_record_has_no_padding[(sizeof(struct ballbot_reading_record) == 20u * sizeof(float)) ? 1 : -1];

/* A reading without any value. Whatever lies beyond a sensor's range is missing. */
#define BALLBOT_MISSING 1e+30f
#define BALLBOT_NO_READING \
    { \
    .encoders_valid = 0, \
    .wheel_counts = { 0, 0, 0, 0 }, \
    .wheel_speeds = { 1e+30f, 1e+30f, 1e+30f, 1e+30f }, /* [rad/s] */ \
    .gyro = { 1e+30f, 1e+30f, 1e+30f }, /* [rad/s] */ \
    .attitude = { 1e+30f, 1e+30f, 1e+30f }, /* [rad] */ \
    .fix_position = { 1e+30f, 1e+30f }, /* [m] */ \
    .fix_heading = 1e+30f, /* [rad] */ \
    .fix_position_deviation = 1e+30f, /* [m] */ \
    .fix_heading_deviation = 1e+30f, /* [rad] */ \
    }

/* Why parameters are refused; from BALLBOT_REFUSED_BOUND on it is the row of the bounds below. */
enum ballbot_refusal {
    BALLBOT_REFUSED_NOT = 0,
    BALLBOT_REFUSED_SCHEMA = 1,
    BALLBOT_REFUSED_POLICY = 2,
    BALLBOT_REFUSED_ROBOT = 3,
    BALLBOT_REFUSED_BOUND = 4
};

/* Whether parameters keep each of their bounds (ballbot/firmware/bounds.py). */
#define BALLBOT_BOUNDS 18
#define BALLBOT_BOUNDS_KEPT(parameters) \
    { \
        ((parameters)->wheel_count >= 3 && (parameters)->wheel_count <= 4), \
        ((parameters)->estimator >= 0 && (parameters)->estimator <= 1), \
        ((parameters)->sample_time >= 1e-06f && (parameters)->sample_time <= 1.0f), \
        ((parameters)->encoder_step >= 1e-09f && (parameters)->encoder_step <= 6.2831855f), \
        ((parameters)->law.torque_limit >= 1e-06f && (parameters)->law.torque_limit <= 1000.0f), \
        ((parameters)->self_test.torque >= 1e-06f && (parameters)->self_test.torque <= 1000.0f), \
        ((parameters)->self_test.ramp >= 1 && (parameters)->self_test.ramp <= 100000), \
        ((parameters)->self_test.counts >= 1 && (parameters)->self_test.counts <= 1073741824), \
        ((parameters)->safety.lean >= 0.001f), \
        ((parameters)->safety.lean >= (parameters)->law.lean_limit.lean), \
        ((parameters)->safety.max_interval >= (parameters)->sample_time), \
        ((parameters)->safety.max_missing >= 0), \
        ((parameters)->safety.max_unchanged >= 0), \
        ((parameters)->safety.turning_torque >= 0.0f && (parameters)->safety.turning_torque <= (parameters)->law.torque_limit), \
        ((parameters)->law.tuning.others >= 0 && (parameters)->law.tuning.others <= 2), \
        ((parameters)->law.planner.every >= (parameters)->law.planner.on && (parameters)->law.planner.every <= 1000), \
        ((parameters)->law.prediction.count >= 0 && (parameters)->law.prediction.count <= 20), \
        ((parameters)->law.prediction.samples >= 0 && (parameters)->law.prediction.samples <= 20) \
    }

#endif

/* A robot for viable's plant `link`, in one file of C: what stands between YOURS marks is your robot's driver, the rest stays.
Here a table without gravity and friction turns, of inertia 1 kg m^2 at each joint (as robots/single_joint).
Usage: link_robot ADDRESS JOINTS SECONDS   (ADDRESS: 127.0.0.1:47100, or shm:NAME)
Build: cc -std=c99 -O2 -I PREFIX/include link_robot.c -o link_robot */
#include "viable/link/viable_link_linux.h"

#include <signal.h>

static volatile sig_atomic_t ends = 0;
static void end(int signal_number) {
    (void)signal_number;
    ends = 1;
}

int main(int argc, char** argv) {
    const double tick_s = 0.001;
    const int joints = argc > 2 ? atoi(argv[2]) : 0;
    const int64_t last = argc > 3 ? (int64_t)(atof(argv[3]) / tick_s) : 0;
    double q[VL_MAX_JOINTS] = {0}, qd[VL_MAX_JOINTS] = {0}, tau[VL_MAX_JOINTS] = {0}, held[VL_MAX_JOINTS];
    char error[256];
    vl_line line;
    vl_robot robot;
    struct timespec next, now;
    if (joints < 1 || joints > VL_MAX_JOINTS) {
        fprintf(stderr, "usage: link_robot ADDRESS JOINTS SECONDS\n");
        return 2;
    }
    if (vl_line_open(&line, argv[1], 1, error, sizeof error) != 0) {
        fprintf(stderr, "link_robot: %s: %s\n", argv[1], error);
        return 2;
    }
    signal(SIGINT, end);
    signal(SIGTERM, end);
    vl_robot_init(&robot, joints, tick_s, vl_random());
    for (int i = 0; i < joints; ++i) { /* YOURS: what your motors take [Nm, Nm per tick] */
        robot.torque_limit[i] = 1000.0;
        robot.torque_step[i] = 20.0;
    }
    memcpy(held, q, sizeof held); /* YOURS: it stays where it stands, */
    vl_robot_note(&robot, tau);   /* and torques set out from what the motors give */
    clock_gettime(CLOCK_MONOTONIC, &next);
    for (int64_t tick = 0; tick < last && !ends; ++tick) { /* or: your vendor's callback, once per tick */
        vl_state state;
        vl_mode mode;
        vl_robot_poll(&robot, &line);
        mode = vl_robot_tick(&robot, tau);
        memset(&state, 0, sizeof state);
        state.flags = VL_ENABLED; /* YOURS: VL_BRAKES, VL_FAULT, VL_ADDS_GRAVITY, ... */
        state.time_ns = vl_now_ns();
        memcpy(state.q, q, sizeof q); /* YOURS: what the sensors say */
        memcpy(state.qd, qd, sizeof qd);
        memcpy(state.tau, robot.torque, sizeof tau);
        vl_robot_send(&robot, &line, &state);
        if (mode == VL_HOLD) { /* YOURS: your own stop and hold */
            for (int i = 0; i < joints; ++i) tau[i] = 100.0 * (held[i] - q[i]) - 20.0 * qd[i];
            vl_robot_limit(&robot, tau);
        }
        for (int i = 0; i < joints; ++i) { /* YOURS: the motors */
            if (mode == VL_TORQUE) held[i] = q[i];
            qd[i] += tick_s * tau[i];
            q[i] += tick_s * qd[i];
        }
        next.tv_nsec += (long)(tick_s * 1e9); /* YOURS: the clock */
        if (next.tv_nsec >= 1000000000) next.tv_nsec -= 1000000000, ++next.tv_sec;
        clock_gettime(CLOCK_MONOTONIC, &now); /* late by more than a tick: it does not catch up in a burst */
        if ((double)(now.tv_sec - next.tv_sec) + 1e-9 * (double)(now.tv_nsec - next.tv_nsec) > tick_s) next = now;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
    }
    vl_line_close(&line);
    printf("ticks %llu, repeated %llu, lapses %llu\n", (unsigned long long)robot.tick,
           (unsigned long long)robot.repeated, (unsigned long long)robot.lapses);
    for (int i = 0; i < VL_RESULTS; ++i)
        if (robot.counts[i])
            printf("packets %s: %llu\n", vl_result_name((vl_result)i), (unsigned long long)robot.counts[i]);
    return 0;
}

/* Skeleton of a driver for viable's plant `link` that is the master of a fieldbus (EtherCAT, CANopen): each cycle exchanges
torques for readings with the drives. YOURS: what to replace (README.md).
Usage: fieldbus ADDRESS SECONDS   (ADDRESS: 127.0.0.1:47100, or shm:NAME) */
#include "viable/link/viable_link_linux.h"

#include "vendor.h" /* YOURS: the header of your fieldbus master */

int main(int argc, char** argv) {
    vendor_drive_in in[VENDOR_JOINTS] = {{0, 0, 0, 0}};
    vendor_drive_out out[VENDOR_JOINTS] = {{0, 0}};
    double tau[VL_MAX_JOINTS] = {0}, held[VENDOR_JOINTS] = {0};
    char error[256];
    vl_line line;
    vl_robot robot;
    struct timespec next;
    uint64_t last;
    if (argc != 3) {
        fprintf(stderr, "usage: fieldbus ADDRESS SECONDS\n");
        return 2;
    }
    if (vl_line_open(&line, argv[1], 1, error, sizeof error) != 0) {
        fprintf(stderr, "fieldbus: %s: %s\n", argv[1], error);
        return 2;
    }
    vl_robot_init(&robot, VENDOR_JOINTS, vendor_tick_s, vl_random());
    for (int i = 0; i < VENDOR_JOINTS; ++i) { /* YOURS: of your drives and gears */
        robot.torque_limit[i] = 1000.0;
        robot.torque_step[i] = 20.0;
    }
    last = (uint64_t)(atof(argv[2]) / vendor_tick_s);
    clock_gettime(CLOCK_MONOTONIC, &next);
    while (robot.tick < last) {
        vl_state state;
        vl_mode mode;
        vendor_exchange(&next, out, in); /* YOURS: waits for the cycle, sends `out`, receives `in` */
        memset(&state, 0, sizeof state);
        state.time_ns = vl_now_ns(); /* YOURS: of the clock that makes the cycles, if it has another one */
        state.flags = VL_ENABLED;
        for (int i = 0; i < VENDOR_JOINTS; ++i) {
            if (!(in[i].status & 1u)) state.flags &= ~(unsigned)VL_ENABLED;
            if (in[i].status & 2u) state.flags |= VL_FAULT;
            state.q[i] = 1e-6 * in[i].position; /* YOURS: units, gears, signs, order of the joints */
            state.qd[i] = 1e-6 * in[i].velocity;
            state.tau[i] = 1e-3 * in[i].torque;
        }
        if (robot.tick == 0) { /* it stays where it stands, and torques set out from what the motors give */
            memcpy(held, state.q, sizeof held);
            vl_robot_note(&robot, state.tau);
        }
        vl_robot_poll(&robot, &line);
        mode = vl_robot_tick(&robot, tau);
        vl_robot_send(&robot, &line, &state);

        if (mode == VL_HOLD) { /* YOURS: come to rest and stay there; or brakes, and vl_robot_note() */
            for (int i = 0; i < VENDOR_JOINTS; ++i) tau[i] = 100.0 * (held[i] - state.q[i]) - 20.0 * state.qd[i];
            vl_robot_limit(&robot, tau);
        } else {
            memcpy(held, state.q, sizeof held);
        }
        for (int i = 0; i < VENDOR_JOINTS; ++i) { /* it acts from the next exchange on */
            out[i].torque = (int)lround(1e3 * tau[i]);
            out[i].control = 1u;
        }
    }
    vl_line_close(&line);
    printf("ticks %llu, good %llu, repeated %llu, lapses %llu\n", (unsigned long long)robot.tick,
           (unsigned long long)robot.counts[VL_GOOD], (unsigned long long)robot.repeated,
           (unsigned long long)robot.lapses);
    return 0;
}

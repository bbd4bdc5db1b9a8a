/* Skeleton of a driver for viable's plant `link` where the vendor's library owns the loop and calls a function once per tick,
as libfranka does: the function gets the state and returns the torque. YOURS: what to replace (README.md).
Usage: callback ADDRESS SECONDS   (ADDRESS: 127.0.0.1:47100, or shm:NAME) */
#include "viable/link/viable_link_linux.h"

#include "vendor.h" /* YOURS: your vendor's header */

typedef struct driver {
    vl_line line;
    vl_robot robot;
    double held[VENDOR_JOINTS];
    uint64_t last;
} driver;

/* Once per millisecond, in the vendor's thread: no allocation, no lock, no output. */
static int on_tick(void* user, const vendor_state* s, double* torque) {
    driver* const d = (driver*)user;
    vl_state out;
    vl_mode mode;
    memset(&out, 0, sizeof out);
    out.flags = VL_ENABLED; /* YOURS: and VL_ADDS_GRAVITY (libfranka does), VL_ADDS_FRICTION, VL_FAULT */
    out.time_ns = s->time_ns;
    for (int i = 0; i < VENDOR_JOINTS; ++i) {
        out.q[i] = s->q[i];
        out.qd[i] = s->dq[i];
        out.tau[i] = s->tau[i]; /* YOURS: with VL_ADDS_GRAVITY less gravity, as torques are sent */
    }
    if (d->robot.tick ==
        0) { /* it stays where it stands, and torques set out from what the motors give, as it is sent */
        memcpy(d->held, s->q, sizeof d->held);
        vl_robot_note(&d->robot, out.tau);
    }
    vl_robot_poll(&d->robot, &d->line);
    mode = vl_robot_tick(&d->robot, torque);
    vl_robot_send(&d->robot, &d->line, &out);

    if (mode == VL_HOLD) { /* YOURS: come to rest and stay there by a law of your own */
        for (int i = 0; i < VENDOR_JOINTS; ++i) torque[i] = 100.0 * (d->held[i] - s->q[i]) - 20.0 * s->dq[i];
        vl_robot_limit(&d->robot, torque);
    } else {
        memcpy(d->held, s->q, sizeof d->held);
    }
    return d->robot.tick >= d->last;
}

int main(int argc, char** argv) {
    static driver d;
    char error[256];
    if (argc != 3) {
        fprintf(stderr, "usage: callback ADDRESS SECONDS\n");
        return 2;
    }
    if (vl_line_open(&d.line, argv[1], 1, error, sizeof error) != 0) {
        fprintf(stderr, "callback: %s: %s\n", argv[1], error);
        return 2;
    }
    vl_robot_init(&d.robot, VENDOR_JOINTS, vendor_tick_s, vl_random());
    for (int i = 0; i < VENDOR_JOINTS;
         ++i) { /* YOURS: libfranka takes 1000 Nm/s, 1 Nm per tick, with gravity's change */
        d.robot.torque_limit[i] = 1000.0;
        d.robot.torque_step[i] = 20.0;
    }
    d.last = (uint64_t)(atof(argv[2]) / vendor_tick_s);
    vendor_control(on_tick, &d); /* YOURS: robot.control(...) */
    vl_line_close(&d.line);
    printf("ticks %llu, good %llu, repeated %llu, lapses %llu\n", (unsigned long long)d.robot.tick,
           (unsigned long long)d.robot.counts[VL_GOOD], (unsigned long long)d.robot.repeated,
           (unsigned long long)d.robot.lapses);
    return 0;
}

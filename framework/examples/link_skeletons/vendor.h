/* Stands for your vendor's library, so that the skeletons run: a table turns, one joint of inertia 1 kg m^2, without friction.
With the skeletons goes away what is in here; its names are invented. */
#ifndef VENDOR_H
#define VENDOR_H

#include <math.h>
#include <time.h>

#define VENDOR_JOINTS 1
static const double vendor_tick_s = 0.001;

typedef struct vendor_state {
    double q[VENDOR_JOINTS], dq[VENDOR_JOINTS], tau[VENDOR_JOINTS];
    long long time_ns;
    int ticks;
} vendor_state;

static void vendor_tick(vendor_state* s, const double* torque) {
    struct timespec now;
    for (int i = 0; i < VENDOR_JOINTS; ++i) {
        s->tau[i] = torque[i];
        s->dq[i] += vendor_tick_s * torque[i];
        s->q[i] += vendor_tick_s * s->dq[i];
    }
    clock_gettime(CLOCK_MONOTONIC, &now);
    s->time_ns = (long long)now.tv_sec * 1000000000 + now.tv_nsec;
    ++s->ticks;
}
static void vendor_sleep(struct timespec* next) { /* to the next tick; late ones are not made up for */
    struct timespec now;
    next->tv_nsec += (long)(vendor_tick_s * 1e9);
    if (next->tv_nsec >= 1000000000) next->tv_nsec -= 1000000000, ++next->tv_sec;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if ((double)(now.tv_sec - next->tv_sec) + 1e-9 * (double)(now.tv_nsec - next->tv_nsec) > vendor_tick_s) *next = now;
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, next, NULL);
}

/* A robot that owns the loop: it calls `tick` each millisecond, which returns other than 0 to end. */
typedef int (*vendor_callback)(void* user, const vendor_state* state, double* torque);
static inline void vendor_control(vendor_callback tick, void* user) {
    vendor_state state = {{0.7}, {0}, {0}, 0, 0};
    double torque[VENDOR_JOINTS] = {0};
    struct timespec next;
    clock_gettime(CLOCK_MONOTONIC, &next);
    for (vendor_tick(&state, torque); tick(user, &state, torque) == 0; vendor_tick(&state, torque)) vendor_sleep(&next);
}

/* Drives on a fieldbus: each cycle exchanges what they are to do for what they measured, in integers of their own. */
typedef struct vendor_drive_in {
    int position, velocity, torque; /* 1e-6 rad, 1e-6 rad/s, 1e-3 Nm */
    unsigned status;                /* bit 0: follows torques; bit 1: fault */
} vendor_drive_in;
typedef struct vendor_drive_out {
    int torque;       /* 1e-3 Nm */
    unsigned control; /* bit 0: follow torques */
} vendor_drive_out;
static inline void vendor_exchange(struct timespec* next, const vendor_drive_out* out, vendor_drive_in* in) {
    static vendor_state state = {{0.7}, {0}, {0}, 0, 0};
    double torque[VENDOR_JOINTS];
    vendor_sleep(next);
    for (int i = 0; i < VENDOR_JOINTS; ++i) torque[i] = out[i].control & 1u ? 1e-3 * out[i].torque : 0.0;
    vendor_tick(&state, torque);
    for (int i = 0; i < VENDOR_JOINTS; ++i) {
        in[i].position = (int)lround(1e6 * state.q[i]);
        in[i].velocity = (int)lround(1e6 * state.dq[i]);
        in[i].torque = (int)lround(1e3 * state.tau[i]);
        in[i].status = out[i].control & 1u;
    }
}

#endif

/* viable_link.h: the link between viable's plant `link` (the host) and any robot, version 1.

One header, C99 or C++17, without dependencies: codec and state machines need <stdint.h> and <string.h> alone, and can be
pasted into any vendor's callback. Transports (UDP, shared memory) follow at the end and need Linux; define
VL_WITHOUT_TRANSPORT for a robot that brings its own. With -std=c99 include this header first, or define _GNU_SOURCE.

Once per tick, the robot: polls commands, asks vl_robot_tick() for the torque, and sends a state (vl_robot_state()). The
host answers every state with a command, which acts from the tick after that state on. The robot's clock makes the ticks: the
host ends where a robot's time [ns] does not agree with the tick that it claims.

Packets: little-endian, of a size fixed by the number n of joints. Bytes:
     0  u32  magic "vLNK"              24  u64  the robot's number of this session
     4  u8   version                   32  u64  sequence (state: number of the tick, from 1)
     5  u8   1 state, 2 command        40  u64  the last sequence that was heard from the other side; 0: none
     6  u8   n                         48  i64  state: the robot's time [ns]
     7  u8   state: VL_... flags;      56  f64  state: n x q, n x qd, n x tau, n x external torque
             command: a vl_mode             command: n x tau
     8  u16  size of the packet       end  16 bytes: CRC-32 (IEEE 802.3) and 12 zeros; with a key SipHash-2-4, 128 bit
    10  u16  command: repeats
    12  u32  tick [ns]
    16  u64  the host's number of this session
Units: rad and Nm (joints that slide: m and N). Torques, commanded and measured, are in one convention: where the robot adds
gravity (VL_ADDS_GRAVITY), both are without it.

Session: the host says hello, a hold command in which the robot's number is 0. The robot answers each hello with one state
and a number that only the caller learns, and that is another one after every session. A session begins with a hold command
that carries both numbers and answers a recent state. So no packet of another session is taken, and of its own each at
most once: with a key, nothing that was recorded is of any use to a stranger, hello included. Without one, whoever reaches the
robot can command it. One host at a time: the first one stays until it says stop or is silent for release_ticks.

Late and lost commands: one that answers state s may act in the ticks s + 1 to s + 1 + repeats. After that the robot holds
itself and tells so (VL_LAPSED) until a hold command comes.

Steps: whatever comes, goes missing or comes late, the torque changes by no more than torque_step per tick, also into and out
of the robot's own hold, whose torque goes through vl_robot_limit(). Nothing here allocates, locks or waits, but for the
functions that say so. SPDX-License-Identifier: Apache-2.0 */
#ifndef VIABLE_LINK_H
#define VIABLE_LINK_H

#if !defined(VL_WITHOUT_TRANSPORT) && !defined(_GNU_SOURCE)
#define _GNU_SOURCE 1
#endif
#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum { VL_VERSION = 1, VL_MAX_JOINTS = 16, VL_HEADER_SIZE = 56, VL_TAG_SIZE = 16, VL_MAX_PACKET = 584 };

/* Flags of a state. */
enum {
    VL_BRAKES = 1,       /* its brakes are closed, or closing */
    VL_ENABLED = 2,      /* its motors follow torques */
    VL_FAULT = 4,        /* it reports a fault of its own */
    VL_ADDS_GRAVITY = 8, /* it adds the torque that holds the arm against gravity */
    VL_ADDS_FRICTION = 16,
    VL_HAS_EXTERNAL = 32, /* the external torque is measured */
    VL_HOLDS = 64,        /* in this tick it does not follow a torque; set by vl_robot_state() */
    VL_LAPSED = 128       /* torques went missing, and it holds itself; set by vl_robot_state() */
};

/* Stop: come to rest, the host goes. Last: a torque after which the host may have gone. */
typedef enum vl_mode { VL_HOLD = 0, VL_TORQUE = 1, VL_STOP = 2 } vl_mode;

/* What a packet came to. Anything but VL_GOOD: it was dropped and counted. */
typedef enum vl_result {
    VL_GOOD,
    VL_FOREIGN,       /* from somebody else, of another session, or nothing of this link */
    VL_OTHER_VERSION, /* of the link */
    VL_OTHER_SIZE,
    VL_OTHER_JOINTS, /* another number of joints */
    VL_OTHER_TICK,
    VL_CORRUPT, /* check sum or key */
    VL_DUPLICATE,
    VL_OLD,    /* a newer one has come, or its time is over */
    VL_ABSURD, /* a number that is not finite or that no arm has */
    VL_RESULTS
} vl_result;

typedef struct vl_key {
    int is_set;
    uint64_t k[2];
} vl_key;

typedef struct vl_session {
    uint64_t host, robot;
} vl_session;

typedef struct vl_state {
    uint64_t sequence, echo;
    int64_t time_ns;
    unsigned flags;
    int joints;
    uint32_t tick_ns;
    double q[VL_MAX_JOINTS], qd[VL_MAX_JOINTS], tau[VL_MAX_JOINTS], external[VL_MAX_JOINTS];
} vl_state;

typedef struct vl_command {
    uint64_t sequence, echo;
    vl_mode mode;
    int repeats; /* ticks for which it may be repeated */
    int joints;
    uint32_t tick_ns;
    double tau[VL_MAX_JOINTS];
} vl_command;

/* What a result is called in messages, as "3 duplicate". */
static inline const char* vl_result_name(vl_result result) {
    static const char* const names[VL_RESULTS] = {"good",         "foreign",    "other version", "other size",
                                                  "other joints", "other tick", "corrupt",       "duplicate",
                                                  "old",          "absurd"};
    return (unsigned)result < (unsigned)VL_RESULTS ? names[result] : "unknown";
}

/* ---- Check sums ------------------------------------------------------------------------------------------------ */

static inline void vl_put(uint8_t* to, uint64_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) to[i] = (uint8_t)(value >> (8 * i) & 0xffu);
}
static inline uint64_t vl_get(const uint8_t* from, int bytes) {
    uint64_t value = 0;
    for (int i = 0; i < bytes; ++i) value |= (uint64_t)from[i] << (8 * i);
    return value;
}

static inline uint32_t vl_crc32(const uint8_t* bytes, size_t size) {
    static const uint32_t table[16] = {0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u,
                                       0x4db26158u, 0x5005713cu, 0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu,
                                       0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu};
    uint32_t crc = 0xffffffffu;
    for (size_t i = 0; i < size; ++i) {
        crc ^= bytes[i];
        crc = crc >> 4 ^ table[crc & 15u];
        crc = crc >> 4 ^ table[crc & 15u];
    }
    return ~crc;
}

static inline uint64_t vl_rotate(uint64_t x, int by) {
    return x << by | x >> (64 - by);
}
static inline void vl_sip_rounds(uint64_t v[4], int rounds) {
    for (int i = 0; i < rounds; ++i) {
        v[0] += v[1];
        v[1] = vl_rotate(v[1], 13) ^ v[0];
        v[0] = vl_rotate(v[0], 32);
        v[2] += v[3];
        v[3] = vl_rotate(v[3], 16) ^ v[2];
        v[0] += v[3];
        v[3] = vl_rotate(v[3], 21) ^ v[0];
        v[2] += v[1];
        v[1] = vl_rotate(v[1], 17) ^ v[2];
        v[2] = vl_rotate(v[2], 32);
    }
}

/* SipHash-2-4 (Aumasson, Bernstein, 2012): 8 bytes, or the 16 of their reference code's long output. */
static inline void vl_siphash(const vl_key* key, const uint8_t* bytes, size_t size, uint8_t* out, int out_size) {
    uint64_t v[4], last = (uint64_t)(size & 0xffu) << 56;
    size_t at = 0;
    v[0] = UINT64_C(0x736f6d6570736575) ^ key->k[0];
    v[1] = UINT64_C(0x646f72616e646f6d) ^ key->k[1];
    v[2] = UINT64_C(0x6c7967656e657261) ^ key->k[0];
    v[3] = UINT64_C(0x7465646279746573) ^ key->k[1];
    if (out_size == 16) v[1] ^= 0xee;
    for (; at + 8 <= size; at += 8) {
        const uint64_t m = vl_get(bytes + at, 8);
        v[3] ^= m;
        vl_sip_rounds(v, 2);
        v[0] ^= m;
    }
    last |= vl_get(bytes + at, (int)(size - at));
    v[3] ^= last;
    vl_sip_rounds(v, 2);
    v[0] ^= last;
    v[2] ^= out_size == 16 ? 0xeeu : 0xffu;
    vl_sip_rounds(v, 4);
    vl_put(out, v[0] ^ v[1] ^ v[2] ^ v[3], 8);
    if (out_size != 16) return;
    v[1] ^= 0xdd;
    vl_sip_rounds(v, 4);
    vl_put(out + 8, v[0] ^ v[1] ^ v[2] ^ v[3], 8);
}

/* A key of 32 hexadecimal digits; white space after them is passed over. Returns 0, or -1 where it is none. */
static inline int vl_key_from_hex(const char* text, vl_key* key) {
    uint8_t bytes[16] = {0};
    for (int i = 0; i < 32; ++i) {
        const char c = text[i];
        const int digit = c >= '0' && c <= '9'   ? c - '0'
                          : c >= 'a' && c <= 'f' ? c - 'a' + 10
                          : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                                 : -1;
        if (digit < 0) return -1;
        bytes[i / 2] = (uint8_t)(bytes[i / 2] << 4 | digit);
    }
    for (text += 32; *text; ++text)
        if (*text != ' ' && *text != '\n' && *text != '\r' && *text != '\t') return -1;
    key->is_set = 1;
    key->k[0] = vl_get(bytes, 8);
    key->k[1] = vl_get(bytes + 8, 8);
    return 0;
}

/* ---- Codec ----------------------------------------------------------------------------------------------------- */

enum { VL_IS_STATE = 1, VL_IS_COMMAND = 2 };
static const uint32_t vl_magic = 0x4b4e4c76u; /* "vLNK" */

/* Finite and at most `largest` by its absolute value; does not rely on the compiler's arithmetic. */
static inline int vl_is_plausible(double x, double largest) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    if ((bits >> 52 & 0x7ffu) == 0x7ffu) return 0;
    return x <= largest && x >= -largest;
}
static inline int vl_are_plausible(const double* x, int count, double largest) {
    for (int i = 0; i < count; ++i)
        if (!vl_is_plausible(x[i], largest)) return 0;
    return 1;
}
static inline void vl_put_numbers(uint8_t* to, const double* x, int count) {
    for (int i = 0; i < count; ++i) {
        uint64_t bits;
        memcpy(&bits, &x[i], sizeof bits);
        vl_put(to + 8 * i, bits, 8);
    }
}
static inline void vl_get_numbers(const uint8_t* from, double* x, int count) {
    for (int i = 0; i < count; ++i) {
        const uint64_t bits = vl_get(from + 8 * i, 8);
        memcpy(&x[i], &bits, sizeof bits);
    }
}

static inline size_t vl_packet_size(int kind, int joints) {
    return (size_t)(VL_HEADER_SIZE + 8 * joints * (kind == VL_IS_STATE ? 4 : 1) + VL_TAG_SIZE);
}
static inline void vl_make_tag(const uint8_t* packet, size_t size, const vl_key* key, uint8_t tag[VL_TAG_SIZE]) {
    memset(tag, 0, VL_TAG_SIZE);
    if (key->is_set)
        vl_siphash(key, packet, size - VL_TAG_SIZE, tag, VL_TAG_SIZE);
    else
        vl_put(tag, vl_crc32(packet, size - VL_TAG_SIZE), 4);
}
static inline void vl_put_header(uint8_t* packet, int kind, int joints, unsigned word, uint32_t tick_ns,
                                 vl_session session, uint64_t sequence, uint64_t echo) {
    memset(packet, 0, VL_HEADER_SIZE);
    vl_put(packet, vl_magic, 4);
    packet[4] = VL_VERSION;
    packet[5] = (uint8_t)kind;
    packet[6] = (uint8_t)joints;
    packet[7] = (uint8_t)word;
    vl_put(packet + 8, vl_packet_size(kind, joints), 2);
    vl_put(packet + 12, tick_ns, 4);
    vl_put(packet + 16, session.host, 8);
    vl_put(packet + 24, session.robot, 8);
    vl_put(packet + 32, sequence, 8);
    vl_put(packet + 40, echo, 8);
}

/* Both write a packet of at most VL_MAX_PACKET bytes and return its size. */
static inline size_t vl_encode_state(uint8_t* packet, const vl_state* s, vl_session session, const vl_key* key) {
    const size_t size = vl_packet_size(VL_IS_STATE, s->joints);
    const int n = s->joints;
    vl_put_header(packet, VL_IS_STATE, n, s->flags, s->tick_ns, session, s->sequence, s->echo);
    vl_put(packet + 48, (uint64_t)s->time_ns, 8);
    vl_put_numbers(packet + VL_HEADER_SIZE, s->q, n);
    vl_put_numbers(packet + VL_HEADER_SIZE + 8 * n, s->qd, n);
    vl_put_numbers(packet + VL_HEADER_SIZE + 16 * n, s->tau, n);
    vl_put_numbers(packet + VL_HEADER_SIZE + 24 * n, s->external, n);
    vl_make_tag(packet, size, key, packet + size - VL_TAG_SIZE);
    return size;
}
static inline size_t vl_encode_command(uint8_t* packet, const vl_command* c, vl_session session, const vl_key* key) {
    const size_t size = vl_packet_size(VL_IS_COMMAND, c->joints);
    vl_put_header(packet, VL_IS_COMMAND, c->joints, (unsigned)c->mode, c->tick_ns, session, c->sequence, c->echo);
    vl_put(packet + 10, (uint64_t)c->repeats, 2);
    vl_put_numbers(packet + VL_HEADER_SIZE, c->tau, c->joints);
    vl_make_tag(packet, size, key, packet + size - VL_TAG_SIZE);
    return size;
}

/* VL_GOOD: a whole packet of this kind, of any number of joints. */
static inline vl_result vl_check_packet(const uint8_t* packet, size_t size, int kind, const vl_key* key) {
    uint8_t tag[VL_TAG_SIZE], difference = 0;
    if (size < 12 || vl_get(packet, 4) != vl_magic) return VL_FOREIGN;
    if (packet[4] != VL_VERSION) return VL_OTHER_VERSION;
    if (packet[5] != kind) return VL_FOREIGN;
    if (packet[6] < 1 || packet[6] > VL_MAX_JOINTS || size != vl_packet_size(kind, packet[6]) ||
        vl_get(packet + 8, 2) != size)
        return VL_OTHER_SIZE;
    vl_make_tag(packet, size, key, tag);
    for (int i = 0; i < VL_TAG_SIZE; ++i) /* in a time that tells nothing of the key */
        difference = (uint8_t)(difference | (tag[i] ^ packet[size - VL_TAG_SIZE + (size_t)i]));
    return difference ? VL_CORRUPT : VL_GOOD;
}

/* Both write their outputs only where they return VL_GOOD. What the numbers are worth is not judged. */
static inline vl_result vl_decode_state(const void* bytes, size_t size, const vl_key* key, vl_state* s,
                                        vl_session* session) {
    const uint8_t* const packet = (const uint8_t*)bytes;
    const vl_result result = vl_check_packet(packet, size, VL_IS_STATE, key);
    int n;
    if (result != VL_GOOD) return result;
    memset(s, 0, sizeof *s);
    n = s->joints = packet[6];
    s->flags = packet[7];
    s->tick_ns = (uint32_t)vl_get(packet + 12, 4);
    session->host = vl_get(packet + 16, 8);
    session->robot = vl_get(packet + 24, 8);
    s->sequence = vl_get(packet + 32, 8);
    s->echo = vl_get(packet + 40, 8);
    s->time_ns = (int64_t)vl_get(packet + 48, 8);
    vl_get_numbers(packet + VL_HEADER_SIZE, s->q, n);
    vl_get_numbers(packet + VL_HEADER_SIZE + 8 * n, s->qd, n);
    vl_get_numbers(packet + VL_HEADER_SIZE + 16 * n, s->tau, n);
    vl_get_numbers(packet + VL_HEADER_SIZE + 24 * n, s->external, n);
    return VL_GOOD;
}
static inline vl_result vl_decode_command(const void* bytes, size_t size, const vl_key* key, vl_command* c,
                                          vl_session* session) {
    const uint8_t* const packet = (const uint8_t*)bytes;
    const vl_result result = vl_check_packet(packet, size, VL_IS_COMMAND, key);
    if (result != VL_GOOD) return result;
    if (packet[7] > VL_STOP) return VL_ABSURD;
    memset(c, 0, sizeof *c);
    c->joints = packet[6];
    c->mode = (vl_mode)packet[7];
    c->repeats = (int)vl_get(packet + 10, 2);
    c->tick_ns = (uint32_t)vl_get(packet + 12, 4);
    session->host = vl_get(packet + 16, 8);
    session->robot = vl_get(packet + 24, 8);
    c->sequence = vl_get(packet + 32, 8);
    c->echo = vl_get(packet + 40, 8);
    vl_get_numbers(packet + VL_HEADER_SIZE, c->tau, c->joints);
    return VL_GOOD;
}

/* ---- The robot's side ------------------------------------------------------------------------------------------ */

typedef struct vl_robot {
    /* Set by vl_robot_init(); may be changed before the first tick. */
    int joints;
    uint32_t tick_ns;
    int most_repeats;                   /* no command is repeated longer, whatever it says [ticks] */
    uint32_t release_ticks;             /* a host that is silent for so long has gone */
    double torque_limit[VL_MAX_JOINTS]; /* largest torque that is written [Nm] */
    double torque_step[VL_MAX_JOINTS];  /* largest change of it per tick [Nm] */
    vl_key key;
    /* To be read. */
    uint64_t tick;               /* of the last vl_robot_tick(), from 1 */
    uint64_t counts[VL_RESULTS]; /* packets */
    uint64_t repeated, lapses;   /* ticks with an older command; times that commands went missing */
    int has_host, has_lapsed;
    double torque[VL_MAX_JOINTS]; /* what was written last [Nm] */
    /* Its own. */
    uint64_t random, sessions, peer, heard_tick, last_sequence;
    uint64_t caller, calls; /* who is answered in this tick, of how many that said hello */
    vl_session session, called;
    vl_command command;
    vl_mode acts;
} vl_robot;

/* joints: up to VL_MAX_JOINTS; seed: a number that nobody can guess, such as vl_random(). The motors give no torque yet: see
vl_robot_note(). */
static inline void vl_robot_init(vl_robot* r, int joints, double tick_s, uint64_t seed) {
    memset(r, 0, sizeof *r);
    r->joints = joints;
    if (r->joints > VL_MAX_JOINTS) r->joints = VL_MAX_JOINTS;
    r->tick_ns = (uint32_t)(tick_s * 1e9 + 0.5);
    r->most_repeats = 100;
    r->release_ticks = (uint32_t)(2.0 / tick_s + 0.5);
    for (int i = 0; i < VL_MAX_JOINTS; ++i) r->torque_limit[i] = r->torque_step[i] = 1e6;
    r->random = seed;
}

/* The robot's number of the next session with this caller: never 0, nobody else can tell it. It follows from the caller, so
that hello is nothing to be remembered, and who says it again and again takes nothing from others. */
static inline uint64_t vl_robot_number(const vl_robot* r, uint64_t host, uint64_t peer) {
    const vl_key key = {1, {r->random, UINT64_C(0x9e3779b97f4a7c15) ^ r->key.k[1]}};
    uint8_t in[24], out[8];
    vl_put(in, host, 8);
    vl_put(in + 8, peer, 8);
    vl_put(in + 16, r->sessions, 8);
    vl_siphash(&key, in, sizeof in, out, 8);
    return vl_get(out, 8) | 1u;
}

/* Whom the next state goes to; 0: nobody. */
static inline uint64_t vl_robot_peer(const vl_robot* r) {
    return r->has_host ? r->peer : r->caller;
}

static inline int vl_is_same_session(vl_session a, vl_session b) {
    return a.host == b.host && a.robot == b.robot;
}

static inline void vl_robot_release(vl_robot* r) {
    if (r->has_host) ++r->sessions;
    r->has_host = 0;
}

static inline vl_result vl_robot_judge(vl_robot* r, const void* bytes, size_t size, uint64_t peer) {
    vl_command c;
    vl_session session;
    vl_result result;
    const int is_first = !r->has_host;
    if (r->has_host && peer != r->peer) return VL_FOREIGN; /* before any work is done for it */
    result = vl_decode_command(bytes, size, &r->key, &c, &session);
    if (result != VL_GOOD) return result;
    if (session.robot == 0) { /* hello */
        if (r->has_host) return session.host == r->session.host ? VL_OLD : VL_FOREIGN;
        if (c.mode != VL_HOLD) return VL_FOREIGN;
        /* One of those that call in a tick is answered, each as likely as the others. */
        if (++r->calls == 1 || vl_robot_number(r, r->tick, r->calls) / 2 % r->calls == 0) {
            r->caller = peer;
            r->called.host = session.host;
            r->called.robot = vl_robot_number(r, session.host, peer);
        }
        return VL_GOOD;
    }
    if (c.joints != r->joints) return VL_OTHER_JOINTS;
    if (c.tick_ns != r->tick_ns) return VL_OTHER_TICK;
    if (is_first) {
        if (peer == r->peer && vl_is_same_session(session, r->session)) return VL_OLD; /* it has ended */
        if (c.mode != VL_HOLD || session.robot != vl_robot_number(r, session.host, peer)) return VL_FOREIGN;
    } else if (!vl_is_same_session(session, r->session)) {
        return VL_FOREIGN;
    } else if (c.sequence <= r->last_sequence) {
        return c.sequence == r->last_sequence ? VL_DUPLICATE : VL_OLD;
    }
    if (c.echo > r->tick || !vl_are_plausible(c.tau, c.joints, 1e6)) return VL_ABSURD;
    if (is_first && r->tick - c.echo > r->release_ticks) return VL_OLD;
    if (c.repeats > r->most_repeats) c.repeats = r->most_repeats;
    if (c.mode == VL_TORQUE && r->tick - c.echo > (uint64_t)c.repeats) return VL_OLD;
    if (is_first) {
        r->has_host = 1;
        r->peer = peer;
        r->session = session;
        r->caller = r->calls = 0;
    }
    r->last_sequence = c.sequence;
    r->heard_tick = r->tick;
    r->command = c;
    r->acts = c.mode;
    if (c.mode == VL_HOLD) r->has_lapsed = 0;
    if (c.mode == VL_STOP) vl_robot_release(r);
    return VL_GOOD;
}

/* Takes a packet that came from `peer`: any number above 0 that tells senders apart, such as a hash of their address. */
static inline vl_result vl_robot_receive(vl_robot* r, const void* bytes, size_t size, uint64_t peer) {
    const vl_result result = vl_robot_judge(r, bytes, size, peer);
    ++r->counts[result];
    return result;
}

/* Of the torque that the robot's own stop and hold wants to write in a tick of VL_HOLD makes the one that may be written [Nm]:
within torque_limit, and no more than torque_step from the last one; what is not finite becomes the last one. */
static inline void vl_robot_limit(vl_robot* r, double* tau) {
    for (int i = 0; i < r->joints; ++i) {
        const double most = r->torque_limit[i], last = r->torque[i];
        const double lowest = last - r->torque_step[i], highest = last + r->torque_step[i];
        double one = vl_is_plausible(tau[i], 1e300) ? tau[i] : last;
        one = one > most ? most : one < -most ? -most : one;
        tau[i] = r->torque[i] = one > highest ? highest : one < lowest ? lowest : one;
    }
}

/* What the motors give now [Nm]: from there the next torque sets out. Before the first tick; in each tick in which the robot
holds itself otherwise, by brakes or its vendor's controller; and where a torque of vl_robot_tick() was not let act. */
static inline void vl_robot_note(vl_robot* r, const double* tau) {
    for (int i = 0; i < r->joints; ++i)
        if (vl_is_plausible(tau[i], 1e300)) r->torque[i] = tau[i];
}

/* Once per tick, after the packets that came: VL_TORQUE, and `tau` [Nm] is to act in this tick, as it is; or VL_HOLD, and the
robot comes to rest and holds itself by its own means; see vl_robot_limit() and vl_robot_note(). */
static inline vl_mode vl_robot_tick(vl_robot* r, double* tau) {
    ++r->tick;
    if (r->has_host && r->tick - r->heard_tick > r->release_ticks) vl_robot_release(r);
    if (r->acts == VL_TORQUE && !r->has_lapsed) {
        const uint64_t age = r->tick - r->command.echo;
        if (r->has_host && age <= 1u + (uint64_t)r->command.repeats) {
            if (age > 1) ++r->repeated;
            memcpy(tau, r->command.tau, (size_t)r->joints * sizeof *tau);
            vl_robot_limit(r, tau);
            return VL_TORQUE;
        }
        r->has_lapsed = 1;
        ++r->lapses;
    }
    return VL_HOLD;
}

/* After vl_robot_tick(): the packet to send to vl_robot_peer(), of at most VL_MAX_PACKET bytes. Returns its size; 0: there is
nobody. Of `s` the caller fills in time_ns (of the clock that makes the ticks; any beginning), q, qd, tau, external and the
flags but VL_HOLDS and VL_LAPSED. */
static inline size_t vl_robot_state(vl_robot* r, vl_state* s, uint8_t* packet) {
    if (!vl_robot_peer(r)) return 0;
    s->sequence = r->tick;
    s->echo = r->has_host ? r->last_sequence : 0;
    s->joints = r->joints;
    s->tick_ns = r->tick_ns;
    s->flags &= ~(unsigned)(VL_HOLDS | VL_LAPSED);
    if (r->has_lapsed) s->flags |= VL_LAPSED;
    if (r->has_lapsed || r->acts != VL_TORQUE) s->flags |= VL_HOLDS;
    r->caller = r->calls = 0; /* answered */
    return vl_encode_state(packet, s, r->has_host ? r->session : r->called, &r->key);
}

/* ---- The host's side ------------------------------------------------------------------------------------------- */

typedef struct vl_host {
    /* Set by vl_host_init(). */
    int joints;
    uint32_t tick_ns;
    uint64_t peer; /* the robot */
    vl_key key;
    double largest_position, largest_velocity, largest_torque; /* more is no arm's [rad or m, Nm or N, s] */
    /* To be read. */
    int is_connected;            /* the robot has taken a command of this session */
    uint64_t counts[VL_RESULTS]; /* packets */
    uint64_t lost;               /* ticks of which no state has come */
    uint64_t last_sequence;      /* of the last good state; 0: none */
    int other_version, other_joints;
    uint32_t other_tick_ns; /* what the last packet that was dropped for it had */
    /* Its own. */
    vl_session session;
    uint64_t sent;
} vl_host;

/* joints: up to VL_MAX_JOINTS; number: of this session, never used before, such as vl_random(). */
static inline void vl_host_init(vl_host* h, int joints, double tick_s, uint64_t number, uint64_t peer) {
    memset(h, 0, sizeof *h);
    h->joints = joints;
    if (h->joints > VL_MAX_JOINTS) h->joints = VL_MAX_JOINTS;
    h->tick_ns = (uint32_t)(tick_s * 1e9 + 0.5);
    h->peer = peer;
    h->largest_position = h->largest_velocity = 1e4;
    h->largest_torque = 1e6;
    h->session.host = number | 1u;
}

static inline vl_result vl_host_judge(vl_host* h, const void* bytes, size_t size, uint64_t peer, vl_state* out) {
    vl_state s;
    vl_session session;
    vl_result result;
    if (peer != h->peer) return VL_FOREIGN;
    result = vl_decode_state(bytes, size, &h->key, &s, &session);
    if (result == VL_OTHER_VERSION) h->other_version = ((const uint8_t*)bytes)[4];
    if (result != VL_GOOD) return result;
    if (session.host != h->session.host || session.robot == 0) return VL_FOREIGN;
    if (s.joints != h->joints) {
        h->other_joints = s.joints;
        return VL_OTHER_JOINTS;
    }
    if (s.tick_ns != h->tick_ns) {
        h->other_tick_ns = s.tick_ns;
        return VL_OTHER_TICK;
    }
    if (session.robot != h->session.robot) {
        if (h->is_connected) return VL_FOREIGN;
        h->session.robot = session.robot;
        h->last_sequence = 0;
    }
    if (s.sequence == h->last_sequence) return VL_DUPLICATE;
    if (s.sequence < h->last_sequence) return VL_OLD;
    if (s.echo > h->sent || !vl_are_plausible(s.q, s.joints, h->largest_position) ||
        !vl_are_plausible(s.qd, s.joints, h->largest_velocity) ||
        !vl_are_plausible(s.tau, s.joints, h->largest_torque) ||
        ((s.flags & VL_HAS_EXTERNAL) && !vl_are_plausible(s.external, s.joints, h->largest_torque)))
        return VL_ABSURD;
    if (h->last_sequence) h->lost += s.sequence - h->last_sequence - 1;
    h->last_sequence = s.sequence;
    if (s.echo > 0) h->is_connected = 1;
    *out = s;
    return VL_GOOD;
}

/* Takes a packet that came from `peer`. VL_GOOD: `out` is newer than all before, and ticks between them were missed. */
static inline vl_result vl_host_receive(vl_host* h, const void* bytes, size_t size, uint64_t peer, vl_state* out) {
    const vl_result result = vl_host_judge(h, bytes, size, peer, out);
    ++h->counts[result];
    return result;
}

/* The packet to send to the robot: the answer to the last state, or hello where there is none yet. Returns its size; 0 for a
torque that is not finite. tau: of VL_TORQUE. */
static inline size_t vl_host_command(vl_host* h, vl_mode mode, const double* tau, int repeats, uint8_t* packet) {
    vl_command c;
    memset(&c, 0, sizeof c);
    if (mode == VL_TORQUE) {
        if (!vl_are_plausible(tau, h->joints, h->largest_torque)) return 0;
        memcpy(c.tau, tau, (size_t)h->joints * sizeof *tau);
    }
    c.sequence = ++h->sent;
    c.echo = h->last_sequence;
    c.mode = mode;
    c.repeats = repeats;
    c.joints = h->joints;
    c.tick_ns = h->tick_ns;
    return vl_encode_command(packet, &c, h->session, &h->key);
}

/* ---- Transports (Linux) ---------------------------------------------------------------------------------------- */
#ifndef VL_WITHOUT_TRANSPORT

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/futex.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

/* The last packet of one direction in shared memory. One process writes, one reads, neither waits for the other: the number
is odd while a packet is written, and what was written meanwhile is not taken. Whoever is killed leaves nothing that has
to be given back. Readers wait for the next number (futex). */
typedef struct vl_mailbox {
    uint32_t number, size;
    uint64_t words[VL_MAX_PACKET / 8];
} vl_mailbox;

typedef struct vl_shared {
    uint64_t magic;
    vl_mailbox state, command;
} vl_shared;

static const uint64_t vl_shared_magic = UINT64_C(0x314d48534b4e4c76); /* "vLNKSHM1" */

/* One end of the link: a UDP socket, or shared memory of the same computer. */
typedef struct vl_line {
    int fd; /* -1: closed */
    int is_robot;
    int is_fixed;                     /* UDP: the system drops what others than `to` send */
    struct sockaddr_storage from, to; /* UDP: the last sender, whom send() writes to */
    socklen_t from_size, to_size;
    vl_shared* shared; /* null: UDP */
    uint32_t seen;
    char name[108];
} vl_line;

/* A number that nobody can guess; reads /dev/urandom. */
static inline uint64_t vl_random(void) {
    uint64_t value = 0;
    struct timespec now;
    const int fd = open("/dev/urandom", O_RDONLY | O_CLOEXEC);
    const ssize_t got = fd < 0 ? -1 : read(fd, &value, sizeof value);
    if (fd >= 0) close(fd);
    if (got == (ssize_t)sizeof value) return value;
    clock_gettime(CLOCK_REALTIME, &now);
    return (uint64_t)now.tv_nsec * UINT64_C(0x9e3779b97f4a7c15) ^ (uint64_t)now.tv_sec ^ (uint64_t)getpid() << 40;
}

/* The key in a file that its owner alone can read and write; see vl_key_from_hex(). Returns 0, or -1 and the reason, with
what helps, in `error`. */
static inline int vl_key_from_file(const char* file, vl_key* key, char* error, size_t size) {
    static const char* const make = "make one: (umask 077; openssl rand -hex 16 > FILE), and give it to both sides";
    char text[128];
    struct stat status;
    const int fd = open(file, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    const ssize_t got = fd < 0 ? -1 : read(fd, text, sizeof text - 1);
    const int is_known = got >= 0 && fstat(fd, &status) == 0;
    const int why = errno;
    if (fd >= 0) close(fd);
    if (!is_known) {
        snprintf(error, size, "it cannot be read: %s; %s", strerror(why), make);
    } else if (status.st_uid != geteuid() && status.st_uid != 0) {
        snprintf(error, size, "it belongs to another user, who can change it; %s", make);
    } else if (status.st_mode & (S_IRWXG | S_IRWXO)) {
        snprintf(error, size, "other users can read or write it (mode %o); if nobody did: chmod 600 %s",
                 (unsigned)status.st_mode & 07777u, file);
    } else {
        text[got] = '\0';
        if (vl_key_from_hex(text, key) == 0) return 0;
        snprintf(error, size, "it does not hold a key of 32 hexadecimal digits; %s", make);
    }
    return -1;
}

/* CLOCK_MONOTONIC [ns]. */
static inline int64_t vl_now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* Of a sender: FNV-1a over address and port. */
static inline uint64_t vl_address_number(const struct sockaddr_storage* address) {
    uint64_t hash = UINT64_C(14695981039346656037);
    uint8_t bytes[18] = {0};
    if (address->ss_family == AF_INET) {
        const struct sockaddr_in* const in = (const struct sockaddr_in*)(const void*)address;
        memcpy(bytes, &in->sin_addr, 4);
        memcpy(bytes + 16, &in->sin_port, 2);
    } else {
        const struct sockaddr_in6* const in = (const struct sockaddr_in6*)(const void*)address;
        memcpy(bytes, &in->sin6_addr, 16);
        memcpy(bytes + 16, &in->sin6_port, 2);
    }
    for (size_t i = 0; i < sizeof bytes; ++i) hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
    return hash | 1u;
}

/* "127.0.0.1:47100" or "[::1]:47100": numbers only, nothing is looked up. Returns 0, or -1 where it is none. */
static inline int vl_parse_address(const char* text, struct sockaddr_storage* address, socklen_t* size) {
    char host[64];
    const char* const colon = strrchr(text, ':');
    const int is_six = text[0] == '[';
    const size_t length = colon ? (size_t)(colon - text) : 0;
    long port = 0;
    memset(address, 0, sizeof *address);
    if (!colon || length < (is_six ? 3u : 1u) || length >= sizeof host || !colon[1]) return -1;
    for (const char* c = colon + 1; *c; ++c) {
        if (*c < '0' || *c > '9') return -1;
        port = 10 * port + (*c - '0');
        if (port > 65535) return -1;
    }
    memcpy(host, text, length);
    host[length] = '\0';
    if (is_six) {
        struct sockaddr_in6* const in = (struct sockaddr_in6*)(void*)address;
        if (host[length - 1] != ']') return -1;
        host[length - 1] = '\0';
        in->sin6_family = AF_INET6;
        in->sin6_port = htons((uint16_t)port);
        *size = sizeof *in;
        return inet_pton(AF_INET6, host + 1, &in->sin6_addr) == 1 ? 0 : -1;
    } else {
        struct sockaddr_in* const in = (struct sockaddr_in*)(void*)address;
        in->sin_family = AF_INET;
        in->sin_port = htons((uint16_t)port);
        *size = sizeof *in;
        return inet_pton(AF_INET, host, &in->sin_addr) == 1 ? 0 : -1;
    }
}

static inline int vl_line_fail(vl_line* line, char* error, size_t size, const char* what, const char* why) {
    snprintf(error, size, "%s%s%s", what, why ? ": " : "", why ? why : "");
    if (line->fd >= 0) close(line->fd);
    line->fd = -1;
    return -1;
}

/* One byte of a file for whoever has opened it: 0 the robot's, 1 the host's. The system takes it back from a process that is
killed. Returns 0, or -1: somebody else has it. */
static inline int vl_lock(int fd, int byte) {
    struct flock lock;
    memset(&lock, 0, sizeof lock);
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    lock.l_start = byte;
    lock.l_len = 1;
    return fcntl(fd, F_OFD_SETLK, &lock);
}
static inline int vl_is_locked(int fd, int byte) {
    struct flock lock;
    memset(&lock, 0, sizeof lock);
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    lock.l_start = byte;
    lock.l_len = 1;
    return fcntl(fd, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

static inline int vl_line_open_shared(vl_line* line, const char* name, char* error, size_t size) {
    struct stat status;
    void* memory;
    if (!*name || strchr(name, '/') || strlen(name) > 100)
        return vl_line_fail(line, error, size, "a name of shared memory is 1 to 100 characters without '/'", NULL);
    snprintf(line->name, sizeof line->name, "/%.100s", name);
    for (int attempt = 0;; ++attempt) {
        line->fd = shm_open(line->name, line->is_robot ? O_RDWR | O_CREAT : O_RDWR, 0600);
        if (line->fd < 0)
            return vl_line_fail(line, error, size,
                                line->is_robot ? "the shared memory cannot be made" : "there is no robot",
                                strerror(errno));
        if (fstat(line->fd, &status) != 0)
            return vl_line_fail(line, error, size, "the shared memory cannot be looked at", strerror(errno));
        if (status.st_uid != geteuid())
            return vl_line_fail(line, error, size, "another user owns this shared memory",
                                "run both sides as one user, or take another name");
        if (status.st_mode & (S_IWGRP | S_IWOTH))
            return vl_line_fail(line, error, size, "other users can write to this shared memory",
                                "remove it from /dev/shm, or take another name");
        if (!line->is_robot && !vl_is_locked(line->fd, 0))
            return vl_line_fail(line, error, size, "there is no robot", "the one that had this shared memory is gone");
        if (vl_lock(line->fd, line->is_robot ? 0 : 1) != 0)
            return vl_line_fail(line, error, size,
                                line->is_robot ? "another robot has this shared memory" : "another host has this robot",
                                NULL);
        /* Who had it may have removed the name since it was opened: nobody would find this one any more. */
        if (fstat(line->fd, &status) == 0 && status.st_nlink > 0) break;
        close(line->fd);
        line->fd = -1;
        if (attempt == 100) return vl_line_fail(line, error, size, "this shared memory is removed all the time", NULL);
    }
    if (line->is_robot && ftruncate(line->fd, (off_t)sizeof(vl_shared)) != 0) {
        shm_unlink(line->name);
        return vl_line_fail(line, error, size, "the shared memory has no room", strerror(errno));
    }
    if (fstat(line->fd, &status) != 0 || status.st_size != (off_t)sizeof(vl_shared))
        return vl_line_fail(line, error, size, "this shared memory is not the link's", NULL);
    memory = mmap(NULL, sizeof(vl_shared), PROT_READ | PROT_WRITE, MAP_SHARED, line->fd, 0);
    if (memory == MAP_FAILED) {
        if (line->is_robot) shm_unlink(line->name);
        return vl_line_fail(line, error, size, "the shared memory cannot be mapped", strerror(errno));
    }
    line->shared = (vl_shared*)memory;
    if (line->is_robot) {
        __atomic_store_n(&line->shared->magic, vl_shared_magic, __ATOMIC_RELEASE);
    } else if (__atomic_load_n(&line->shared->magic, __ATOMIC_ACQUIRE) != vl_shared_magic) {
        munmap(memory, sizeof(vl_shared));
        line->shared = NULL;
        return vl_line_fail(line, error, size, "this shared memory is not the link's", NULL);
    }
    line->seen =
        __atomic_load_n(line->is_robot ? &line->shared->command.number : &line->shared->state.number, __ATOMIC_ACQUIRE);
    return 0;
}

/* UDP: from now on the system drops what others than `to` send, or no more. */
static inline int vl_line_fix(vl_line* line, int is_fixed) {
    struct sockaddr nobody;
    if (line->shared || line->is_fixed == is_fixed) return 0;
    memset(&nobody, 0, sizeof nobody);
    nobody.sa_family = AF_UNSPEC;
    if (connect(line->fd, is_fixed ? (const struct sockaddr*)(const void*)&line->to : &nobody,
                is_fixed ? line->to_size : (socklen_t)sizeof nobody) != 0)
        return -1;
    line->is_fixed = is_fixed;
    return 0;
}

/* UDP: a socket that listens at `to`. Port 0 becomes a free one, by its number: one that was bound as 0 is given back when
vl_line_fix() ends. Returns 0, or -1: see errno. */
static inline int vl_line_listen(vl_line* line) {
    const int one = 1;
    struct sockaddr_storage at = line->to;
    const int is_six = at.ss_family == AF_INET6;
    in_port_t* const port =
        is_six ? &((struct sockaddr_in6*)(void*)&at)->sin6_port : &((struct sockaddr_in*)(void*)&at)->sin_port;
    const int is_any = *port == 0;
    for (int attempt = 0; attempt < 20; ++attempt) {
        socklen_t size = sizeof at;
        const int was_any = *port == 0;
        line->fd = socket(at.ss_family, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
        if (line->fd < 0) return -1;
        if (is_six) setsockopt(line->fd, IPPROTO_IPV6, IPV6_V6ONLY, &one, sizeof one);
        if (bind(line->fd, (const struct sockaddr*)(const void*)&at, line->to_size) != 0) {
            if (!is_any || was_any || errno != EADDRINUSE) return -1;
            *port = 0; /* somebody was quicker */
        } else {
            if (!was_any) return 0;
            if (getsockname(line->fd, (struct sockaddr*)(void*)&at, &size) != 0) return -1;
        }
        close(line->fd);
        line->fd = -1;
    }
    errno = EADDRINUSE;
    return -1;
}

/* address: of the robot, "127.0.0.1:47100", "[::1]:47100" or "shm:NAME". The robot listens there (port 0: a free one, see
vl_line_port()), the host calls it. Returns 0, or -1 and the reason in `error`. */
static inline int vl_line_open(vl_line* line, const char* address, int is_robot, char* error, size_t size) {
    memset(line, 0, sizeof *line);
    line->fd = -1;
    line->is_robot = is_robot;
    if (strncmp(address, "shm:", 4) == 0) return vl_line_open_shared(line, address + 4, error, size);
    if (vl_parse_address(address, &line->to, &line->to_size) != 0)
        return vl_line_fail(line, error, size,
                            "an address is numeric, as 127.0.0.1:47100 or [::1]:47100, or shm:NAME for shared memory",
                            NULL);
    if (is_robot) {
        if (vl_line_listen(line) != 0)
            return vl_line_fail(line, error, size, "this address cannot be listened at", strerror(errno));
        line->to_size = 0;
        return 0;
    }
    line->fd = socket(line->to.ss_family, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (line->fd < 0) return vl_line_fail(line, error, size, "no socket", strerror(errno));
    return vl_line_fix(line, 1) == 0 ? 0 : vl_line_fail(line, error, size, "no way leads there", strerror(errno));
}

static inline void vl_line_close(vl_line* line) {
    if (line->shared) {
        munmap(line->shared, sizeof(vl_shared));
        if (line->is_robot) shm_unlink(line->name); /* while it is locked */
    }
    if (line->fd >= 0) close(line->fd);
    line->shared = NULL;
    line->fd = -1;
}

/* UDP: where it listens. */
static inline int vl_line_port(const vl_line* line) {
    struct sockaddr_storage own;
    socklen_t size = sizeof own;
    if (line->shared || getsockname(line->fd, (struct sockaddr*)(void*)&own, &size) != 0) return 0;
    if (own.ss_family == AF_INET) return ntohs(((const struct sockaddr_in*)(const void*)&own)->sin_port);
    return ntohs(((const struct sockaddr_in6*)(const void*)&own)->sin6_port);
}

/* The number of whom send() writes to, as receive() tells it. */
static inline uint64_t vl_line_peer(const vl_line* line) {
    return line->shared ? 1 : vl_address_number(&line->to);
}

static inline int vl_mailbox_write(vl_mailbox* box, const uint8_t* bytes, size_t size) {
    const uint32_t number =
        __atomic_load_n(&box->number, __ATOMIC_RELAXED) | 1u; /* odd already: the last one was killed */
    if (size > VL_MAX_PACKET) return -1;
    __atomic_store_n(&box->number, number, __ATOMIC_RELAXED);
    __atomic_thread_fence(__ATOMIC_RELEASE);
    __atomic_store_n(&box->size, (uint32_t)size, __ATOMIC_RELAXED);
    for (size_t at = 0; at < size; at += 8) {
        uint64_t word = 0;
        memcpy(&word, bytes + at, size - at < 8 ? size - at : 8);
        __atomic_store_n(&box->words[at / 8], word, __ATOMIC_RELAXED);
    }
    __atomic_store_n(&box->number, number + 1u, __ATOMIC_RELEASE);
    syscall(SYS_futex, &box->number, FUTEX_WAKE, 1 << 30, NULL, NULL, 0);
    return 0;
}

/* Returns the size of a packet that is newer than `seen`; 0: there is none that is whole. */
static inline size_t vl_mailbox_read(const vl_mailbox* box, uint32_t* seen, uint8_t* bytes, size_t room) {
    for (int attempt = 0; attempt < 64; ++attempt) {
        const uint32_t number = __atomic_load_n(&box->number, __ATOMIC_ACQUIRE);
        size_t size;
        if (number == *seen) return 0;
        if (number & 1u) continue;
        size = __atomic_load_n(&box->size, __ATOMIC_RELAXED);
        if (size > room || size > VL_MAX_PACKET) size = 0; /* nonsense, or torn */
        for (size_t at = 0; at < size; at += 8) {
            const uint64_t word = __atomic_load_n(&box->words[at / 8], __ATOMIC_RELAXED);
            memcpy(bytes + at, &word, size - at < 8 ? size - at : 8);
        }
        __atomic_thread_fence(__ATOMIC_ACQUIRE);
        if (__atomic_load_n(&box->number, __ATOMIC_RELAXED) != number) continue;
        *seen = number;
        return size;
    }
    return 0;
}

/* Returns the size of the next packet (shared memory: the last one), 0: none came in that time, and its sender. Waits for at
most timeout_ns; `bytes` has room for VL_MAX_PACKET + 1: a longer packet is as long as that. */
static inline size_t vl_line_receive(vl_line* line, uint8_t* bytes, int64_t timeout_ns, uint64_t* peer) {
    const int64_t end = timeout_ns > 0 ? vl_now_ns() + timeout_ns : 0;
    for (;;) {
        int64_t left;
        struct timespec wait;
        if (line->shared) {
            const vl_mailbox* const box = line->is_robot ? &line->shared->command : &line->shared->state;
            const size_t size = vl_mailbox_read(box, &line->seen, bytes, VL_MAX_PACKET);
            *peer = 1;
            if (size > 0) return size;
        } else {
            ssize_t size;
            line->from_size = sizeof line->from;
            size = recvfrom(line->fd, bytes, VL_MAX_PACKET + 1, MSG_DONTWAIT, (struct sockaddr*)(void*)&line->from,
                            &line->from_size);
            if (size >= 0) {
                *peer = vl_address_number(&line->from);
                if (size > 0) return (size_t)size;
                bytes[0] = 0; /* an empty one is as foreign as one of a byte */
                return 1;
            }
        }
        left = timeout_ns > 0 ? end - vl_now_ns() : 0;
        if (left <= 0) return 0;
        wait.tv_sec = (time_t)(left / 1000000000);
        wait.tv_nsec = (long)(left % 1000000000);
        if (line->shared) {
            vl_mailbox* const box = line->is_robot ? &line->shared->command : &line->shared->state;
            if (__atomic_load_n(&box->number, __ATOMIC_RELAXED) & 1u) { /* being written, or its writer is gone */
                if (left > 100000) wait.tv_sec = 0, wait.tv_nsec = 100000;
                nanosleep(&wait, NULL);
            } else {
                syscall(SYS_futex, &box->number, FUTEX_WAIT, line->seen, &wait, NULL, 0);
            }
        } else {
            struct pollfd ready;
            ready.fd = line->fd;
            ready.events = POLLIN;
            ready.revents = 0;
            ppoll(&ready, 1, &wait, NULL);
        }
    }
}

/* Returns 0, or -1: the system did not take it. Does not wait. */
static inline int vl_line_send(vl_line* line, const uint8_t* bytes, size_t size) {
    if (line->shared)
        return vl_mailbox_write(line->is_robot ? &line->shared->state : &line->shared->command, bytes, size);
    for (int attempt = 0; attempt < 2; ++attempt) { /* the first may tell that an earlier one was refused */
        if (sendto(line->fd, bytes, size, MSG_DONTWAIT | MSG_NOSIGNAL, (const struct sockaddr*)(const void*)&line->to,
                   line->to_size) == (ssize_t)size)
            return 0;
        if (errno != ECONNREFUSED) break;
    }
    return -1;
}

/* Packets that are looked at in one tick, whoever sends them; what is beyond waits, and is lost where the system has no room. */
enum { VL_MOST_PACKETS = 64 };

/* The robot takes the packets that have come. Does not wait. */
static inline void vl_robot_poll(vl_robot* r, vl_line* line) {
    uint8_t bytes[VL_MAX_PACKET + 1];
    uint64_t peer = 0;
    size_t size;
    for (int i = 0; i < VL_MOST_PACKETS && (size = vl_line_receive(line, bytes, 0, &peer)) > 0; ++i) {
        vl_robot_receive(r, bytes, size, peer);
        if (vl_robot_peer(r) == peer) {
            line->to = line->from;
            line->to_size = line->from_size;
        }
    }
    vl_line_fix(line, r->has_host);
}

/* The robot tells its state to its host, if it has one; see vl_robot_state(). Does not wait. */
static inline void vl_robot_send(vl_robot* r, vl_line* line, vl_state* s) {
    uint8_t packet[VL_MAX_PACKET];
    const size_t size = vl_robot_state(r, s, packet);
    if (size > 0) vl_line_send(line, packet, size);
}

#endif /* VL_WITHOUT_TRANSPORT */
#endif /* VIABLE_LINK_H */

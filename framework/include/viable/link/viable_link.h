/* viable_link.h: the link between viable's plant `link` (the host) and any robot, version 1.

One header, C99 or C++17, without dependencies: codec and state machines need <stdint.h> and <string.h> alone, and can
be pasted into any vendor's callback. A robot under Linux takes its transports (UDP, shared memory) from
viable_link_linux.h.

Once per tick, the robot: polls commands, asks vl_robot_tick() for the torque, and sends a state (vl_robot_state()). The
host answers every state with a command, which acts from the tick after that state on. The robot's clock makes the
ticks: the host ends where a robot's time [ns] does not agree with the tick that it claims.

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
Units: rad and Nm (joints that slide: m and N). Torques, commanded and measured, are in one convention: where the robot
adds gravity (VL_ADDS_GRAVITY), both are without it.

Session: the host says hello, a hold command in which the robot's number is 0. The robot answers each hello with one
state and a number that only the caller learns, and that is another one after every session. A session begins with a
hold command that carries both numbers and answers a recent state. So no packet of another session is taken, and each
packet of this session at most once. With a key, recorded packets are of no use to an attacker, hello included. Without
a key, whoever reaches the robot can command it. One host at a time: the first one stays until it says stop or is silent
for release_ticks.

Late and lost commands: one that answers state s may act in the ticks s + 1 to s + 1 + repeats. After that the robot
holds itself and tells so (VL_LAPSED) until a hold command comes.

Steps: the torque changes by no more than torque_step per tick, for any packets that come, are lost or come late.
This holds also into and out of the robot's own hold, whose torque goes through vl_robot_limit(). Nothing here
allocates, locks or waits, but for the functions that say so. SPDX-License-Identifier: Apache-2.0 */
#ifndef VIABLE_LINK_H
#define VIABLE_LINK_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum { VL_VERSION = 1, VL_MAX_JOINTS = 16, VL_HEADER_SIZE = 56, VL_TAG_SIZE = 16, VL_MAX_PACKET = 584 };

/* Flags of a state. */
enum {
    VL_BRAKES = 1,       /* the brakes are closed, or closing */
    VL_ENABLED = 2,      /* the motors follow torques */
    VL_FAULT = 4,        /* it reports a fault of its own */
    VL_ADDS_GRAVITY = 8, /* it adds the torque that holds the arm against gravity */
    VL_ADDS_FRICTION = 16,
    VL_HAS_EXTERNAL = 32, /* the external torque is measured */
    VL_HOLDS = 64,        /* in this tick it does not follow a torque; set by vl_robot_state() */
    VL_LAPSED = 128       /* torques went missing, and it holds itself; set by vl_robot_state() */
};

/* Stop: come to rest, the host goes. Last: a torque after which the host may have gone. */
typedef enum vl_mode { VL_HOLD = 0, VL_TORQUE = 1, VL_STOP = 2 } vl_mode;

/* Fate of a packet. Anything but VL_GOOD: it was dropped and counted. */
typedef enum vl_result {
    VL_GOOD,
    VL_OTHER_SESSION, /* from somebody else, of another session, or nothing of this link */
    VL_OTHER_VERSION, /* another version of the link */
    VL_OTHER_SIZE,
    VL_OTHER_JOINTS, /* another number of joints */
    VL_OTHER_TICK,
    VL_CORRUPT, /* check sum or key */
    VL_DUPLICATE,
    VL_OLD,     /* a newer one has come, or its time is over */
    VL_INVALID, /* a number that is not finite or that no arm has */
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

/* The name of a result in messages, as in "3 duplicate". */
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
    if (size < 12 || vl_get(packet, 4) != vl_magic) return VL_OTHER_SESSION;
    if (packet[4] != VL_VERSION) return VL_OTHER_VERSION;
    if (packet[5] != kind) return VL_OTHER_SESSION;
    if (packet[6] < 1 || packet[6] > VL_MAX_JOINTS || size != vl_packet_size(kind, packet[6]) ||
        vl_get(packet + 8, 2) != size)
        return VL_OTHER_SIZE;
    vl_make_tag(packet, size, key, tag);
    for (int i = 0; i < VL_TAG_SIZE; ++i) /* in a time that tells nothing of the key */
        difference = (uint8_t)(difference | (tag[i] ^ packet[size - VL_TAG_SIZE + (size_t)i]));
    return difference ? VL_CORRUPT : VL_GOOD;
}

/* Both write their outputs only where they return VL_GOOD. They do not check whether the numbers are plausible. */
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
    if (packet[7] > VL_STOP) return VL_INVALID;
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
    uint64_t tick;               /* number of the last vl_robot_tick(), from 1 */
    uint64_t counts[VL_RESULTS]; /* packets */
    uint64_t repeated, lapses;   /* ticks with an older command; times that commands went missing */
    int has_host, has_lapsed;
    double torque[VL_MAX_JOINTS]; /* the last written one [Nm] */
    /* Internal. */
    uint64_t random, sessions, peer, heard_tick, last_sequence;
    uint64_t caller, calls;  /* the host to answer in this tick, and how many said hello */
    uint64_t addresses, met; /* how many addresses they came from, a bit for each */
    uint64_t same;           /* how many came from the caller's */
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

static inline void vl_robot_answered(vl_robot* r) {
    r->caller = r->calls = r->addresses = r->same = r->met = 0;
}

static inline void vl_robot_release(vl_robot* r) {
    if (r->has_host) ++r->sessions;
    r->has_host = 0;
}

static inline vl_result vl_robot_check(vl_robot* r, const void* bytes, size_t size, uint64_t peer) {
    vl_command c;
    vl_session session;
    uint64_t bit, chance = 0;
    const int is_first = !r->has_host;
    if (r->has_host && peer != r->peer) return VL_OTHER_SESSION; /* before any work is done for it */
    const vl_result result = vl_decode_command(bytes, size, &r->key, &c, &session);
    if (result != VL_GOOD) return result;
    if (session.robot == 0) { /* hello */
        if (r->has_host) return session.host == r->session.host ? VL_OLD : VL_OTHER_SESSION;
        if (c.mode != VL_HOLD) return VL_OTHER_SESSION;
        /* One of the addresses that call in a tick is answered, each about as likely as the others, however often it calls. All calls
        of an address are as likely as each other. */
        bit = UINT64_C(1) << (vl_robot_number(r, ~r->tick, peer) >> 58);
        if (!(r->met & bit))
            chance = ++r->addresses;
        else if (peer == r->caller)
            chance = ++r->same;
        if (chance && vl_robot_number(r, r->tick, ++r->calls) / 2 % chance == 0) {
            if (!(r->met & bit)) r->same = 1;
            r->caller = peer;
            r->called.host = session.host;
            r->called.robot = vl_robot_number(r, session.host, peer);
        }
        r->met |= bit;
        return VL_GOOD;
    }
    if (c.joints != r->joints) return VL_OTHER_JOINTS;
    if (c.tick_ns != r->tick_ns) return VL_OTHER_TICK;
    if (is_first) {
        if (peer == r->peer && vl_is_same_session(session, r->session)) return VL_OLD; /* it has ended */
        if (c.mode != VL_HOLD || session.robot != vl_robot_number(r, session.host, peer)) return VL_OTHER_SESSION;
    } else if (!vl_is_same_session(session, r->session)) {
        return VL_OTHER_SESSION;
    } else if (c.sequence <= r->last_sequence) {
        return c.sequence == r->last_sequence ? VL_DUPLICATE : VL_OLD;
    }
    if (c.echo > r->tick || !vl_are_plausible(c.tau, c.joints, 1e6)) return VL_INVALID;
    if (is_first && r->tick - c.echo > r->release_ticks) return VL_OLD;
    if (c.repeats > r->most_repeats) c.repeats = r->most_repeats;
    if (c.mode == VL_TORQUE && r->tick - c.echo > (uint64_t)c.repeats) return VL_OLD;
    if (is_first) {
        r->has_host = 1;
        r->peer = peer;
        r->session = session;
        vl_robot_answered(r);
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
    const vl_result result = vl_robot_check(r, bytes, size, peer);
    ++r->counts[result];
    return result;
}

/* Limits a torque of the robot's own stop and hold in a tick of VL_HOLD [Nm]. `tau` comes to lie within
torque_limit, and no more than torque_step from the last one. Values that are not finite become the last one. */
static inline void vl_robot_limit(vl_robot* r, double* tau) {
    for (int i = 0; i < r->joints; ++i) {
        const double most = r->torque_limit[i], last = r->torque[i];
        const double lowest = last - r->torque_step[i], highest = last + r->torque_step[i];
        double one = vl_is_plausible(tau[i], 1e300) ? tau[i] : last;
        one = one > most ? most : one < -most ? -most : one;
        tau[i] = r->torque[i] = one > highest ? highest : one < lowest ? lowest : one;
    }
}

/* Notes the present torque of the motors [Nm], from which the next torque starts. Call it before the first tick, and
in each tick in which the robot holds itself by brakes or by its vendor's controller. Call it also where a torque of
vl_robot_tick() did not act. */
static inline void vl_robot_note(vl_robot* r, const double* tau) {
    for (int i = 0; i < r->joints; ++i)
        if (vl_is_plausible(tau[i], 1e300)) r->torque[i] = tau[i];
}

/* Call it once per tick, after the packets that came. VL_TORQUE: `tau` [Nm] is to act in this tick, as it is.
VL_HOLD: the robot comes to rest and holds itself by its own means; see vl_robot_limit() and vl_robot_note(). */
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

/* After vl_robot_tick(): the packet to send to vl_robot_peer(), of at most VL_MAX_PACKET bytes. Returns its size; 0:
there is nobody. The caller fills in q, qd, tau, external, the flags but VL_HOLDS and VL_LAPSED, and time_ns. This is
the time of the clock that makes the ticks, with any beginning. */
static inline size_t vl_robot_state(vl_robot* r, vl_state* s, uint8_t* packet) {
    if (!vl_robot_peer(r)) return 0;
    s->sequence = r->tick;
    s->echo = r->has_host ? r->last_sequence : 0;
    s->joints = r->joints;
    s->tick_ns = r->tick_ns;
    s->flags &= ~(unsigned)(VL_HOLDS | VL_LAPSED);
    if (r->has_lapsed) s->flags |= VL_LAPSED;
    if (r->has_lapsed || r->acts != VL_TORQUE) s->flags |= VL_HOLDS;
    vl_robot_answered(r);
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
    uint64_t last_sequence;      /* number of the last good state; 0: none */
    int other_version, other_joints;
    uint32_t other_tick_ns; /* figures of the last packet that was dropped for them */
    /* Internal. */
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
    if (peer != h->peer) return VL_OTHER_SESSION;
    const vl_result result = vl_decode_state(bytes, size, &h->key, &s, &session);
    if (result == VL_OTHER_VERSION) h->other_version = ((const uint8_t*)bytes)[4];
    if (result != VL_GOOD) return result;
    if (session.host != h->session.host || session.robot == 0) return VL_OTHER_SESSION;
    if (s.joints != h->joints) {
        h->other_joints = s.joints;
        return VL_OTHER_JOINTS;
    }
    if (s.tick_ns != h->tick_ns) {
        h->other_tick_ns = s.tick_ns;
        return VL_OTHER_TICK;
    }
    if (session.robot != h->session.robot) {
        if (h->is_connected) return VL_OTHER_SESSION;
        h->session.robot = session.robot;
        h->last_sequence = 0;
    }
    if (s.sequence == h->last_sequence) return VL_DUPLICATE;
    if (s.sequence < h->last_sequence) return VL_OLD;
    if (s.echo > h->sent || !vl_are_plausible(s.q, s.joints, h->largest_position) ||
        !vl_are_plausible(s.qd, s.joints, h->largest_velocity) ||
        !vl_are_plausible(s.tau, s.joints, h->largest_torque) ||
        ((s.flags & VL_HAS_EXTERNAL) && !vl_are_plausible(s.external, s.joints, h->largest_torque)))
        return VL_INVALID;
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

#endif /* VIABLE_LINK_H */

/* viable_link_linux.h: transports of the link of viable_link.h for Linux, C99 or C++17: UDP, and shared memory of the same
computer; random numbers, keys and clocks. With -std=c99 include this header first, or define _GNU_SOURCE.
SPDX-License-Identifier: Apache-2.0 */
#ifndef VIABLE_LINK_LINUX_H
#define VIABLE_LINK_LINUX_H

#ifndef _GNU_SOURCE
#define _GNU_SOURCE 1
#endif
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

#include "viable_link.h"

/* The last packet of one direction in shared memory. One process writes, one reads, neither waits for the other. The
number is odd while a packet is written, and a packet that was written meanwhile is not taken. Whoever is killed
leaves nothing that has to be given back. Readers wait for the next number (futex). */
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

/* The number of a sender: FNV-1a over address and port. */
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
    }
    struct sockaddr_in* const in = (struct sockaddr_in*)(void*)address;
    in->sin_family = AF_INET;
    in->sin_port = htons((uint16_t)port);
    *size = sizeof *in;
    return inet_pton(AF_INET, host, &in->sin_addr) == 1 ? 0 : -1;
}

static inline int vl_line_fail(vl_line* line, char* error, size_t size, const char* what, const char* why) {
    snprintf(error, size, "%s%s%s", what, why ? ": " : "", why ? why : "");
    if (line->fd >= 0) close(line->fd);
    line->fd = -1;
    return -1;
}

static inline struct flock vl_lock_of(int byte) {
    struct flock lock;
    memset(&lock, 0, sizeof lock);
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    lock.l_start = byte;
    lock.l_len = 1;
    return lock;
}

/* One byte of a file for whoever has opened it: 0 the robot's, 1 the host's. The system takes it back from a process that is
killed. Returns 0, or -1: somebody else has it. */
static inline int vl_lock(int fd, int byte) {
    struct flock lock = vl_lock_of(byte);
    return fcntl(fd, F_OFD_SETLK, &lock);
}
static inline int vl_is_locked(int fd, int byte) {
    struct flock lock = vl_lock_of(byte);
    return fcntl(fd, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

static inline int vl_line_open_shared(vl_line* line, const char* name, char* error, size_t size) {
    struct stat status;
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
        /* The process that had it may have removed the name since: nobody would find this one any more. */
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
    void* const memory = mmap(NULL, sizeof(vl_shared), PROT_READ | PROT_WRITE, MAP_SHARED, line->fd, 0);
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
        if (number == *seen) return 0;
        if (number & 1u) continue;
        size_t size = __atomic_load_n(&box->size, __ATOMIC_RELAXED);
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
        if (line->shared) {
            const vl_mailbox* const box = line->is_robot ? &line->shared->command : &line->shared->state;
            const size_t size = vl_mailbox_read(box, &line->seen, bytes, VL_MAX_PACKET);
            *peer = 1;
            if (size > 0) return size;
        } else {
            line->from_size = sizeof line->from;
            const ssize_t size = recvfrom(line->fd, bytes, VL_MAX_PACKET + 1, MSG_DONTWAIT,
                                          (struct sockaddr*)(void*)&line->from, &line->from_size);
            if (size >= 0) {
                *peer = vl_address_number(&line->from);
                if (size > 0) return (size_t)size;
                bytes[0] = 0; /* an empty one is as foreign as one of a byte */
                return 1;
            }
        }
        const int64_t left = timeout_ns > 0 ? end - vl_now_ns() : 0;
        if (left <= 0) return 0;
        struct timespec wait = {(time_t)(left / 1000000000), (long)(left % 1000000000)};
        if (line->shared) {
            vl_mailbox* const box = line->is_robot ? &line->shared->command : &line->shared->state;
            if (__atomic_load_n(&box->number, __ATOMIC_RELAXED) & 1u) { /* being written, or its writer is gone */
                if (left > 100000) wait.tv_sec = 0, wait.tv_nsec = 100000;
                nanosleep(&wait, NULL);
            } else {
                syscall(SYS_futex, &box->number, FUTEX_WAIT, line->seen, &wait, NULL, 0);
            }
        } else {
            struct pollfd ready = {line->fd, POLLIN, 0};
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

#endif /* VIABLE_LINK_LINUX_H */

/* Makes system calls on the files of a run fail, for the tests of faults. Loaded by LD_PRELOAD.
 *
 * A call writes, cuts or flushes a file, or makes, renames or links one.
 *
 * FAULT_PATH   part of the path of the files concerned
 * FAULT_CALL   the call that fails first, counted from 1 in each process; 0 only counts
 * FAULT_CALLS  how many calls fail from then on (default: all)
 * FAULT_KIND   enospc, eio: the call fails; short: half is written; kill: the process dies before
 *              the call; torn: it dies after half of the write; close: every close of a file that
 *              was written fails from the call on; close-read: closes of files that were only read
 *              fail, FAULT_CALL counts them
 * FAULT_RANK   the rank concerned (default: all)
 * FAULT_COUNT  file that gets "rank calls" when the process ends
 * FAULT_LOCKS  errno of every lock: a file system without locks
 * FAULT_SIGNAL number of a signal that comes as soon as the first handler for it is installed
 * FAULT_OPEN   end of the path of a file that cannot be opened for now: too many are open
 */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/uio.h>
#include <unistd.h>

static atomic_long calls, closes, read_closes;

static long number(const char *name, long otherwise) {
    const char *text = getenv(name);
    return text ? atol(text) : otherwise;
}

static long rank(void) {
    return number("OMPI_COMM_WORLD_RANK", number("PMIX_RANK", number("PMI_RANK", 0)));
}

static int concerned(const char *path) {
    const char *part = getenv("FAULT_PATH");
    return part && path[0] == '/' && strstr(path, part) != NULL;
}

enum fault { NONE, FAIL, SHORT, KILL, TORN };

/* What becomes of a call on this path; sets errno if it fails. */
static enum fault fault_at(const char *path) {
    if (!concerned(path)) return NONE;
    long call = atomic_fetch_add(&calls, 1) + 1;
    long of_rank = number("FAULT_RANK", -1), first = number("FAULT_CALL", 0);
    long many = number("FAULT_CALLS", 1L << 40);
    if (!first || call < first || call >= first + many) return NONE;
    if (of_rank >= 0 && of_rank != rank()) return NONE;
    const char *kind = getenv("FAULT_KIND");
    if (!kind) return NONE;
    if (!strcmp(kind, "enospc")) { errno = ENOSPC; return FAIL; }
    if (!strcmp(kind, "eio")) { errno = EIO; return FAIL; }
    if (!strcmp(kind, "short")) return SHORT;
    if (!strcmp(kind, "kill")) return KILL;
    if (!strcmp(kind, "torn")) return TORN;
    return NONE;
}

static enum fault fault(int fd) {
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    if (n < 0) return NONE;
    path[n] = 0;
    return fault_at(path);
}

static void die(void) {
    kill(getpid(), SIGKILL);
    for (;;) pause();
}

__attribute__((destructor)) static void report(void) {
    const char *path = getenv("FAULT_COUNT");
    FILE *file = path ? fopen(path, "a") : NULL;
    if (file) {
        fprintf(file, "%ld %ld\n", rank(), atomic_load(&calls));
        fclose(file);
    }
}

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

int sigaction(int signal, const struct sigaction *action, struct sigaction *before) {
    REAL(int, "sigaction", int, const struct sigaction *, struct sigaction *);
    static atomic_flag came = ATOMIC_FLAG_INIT;
    int result = real(signal, action, before);
    int handles = action && action->sa_handler != SIG_DFL && action->sa_handler != SIG_IGN;
    if (handles && signal == number("FAULT_SIGNAL", 0) && !atomic_flag_test_and_set(&came)) kill(getpid(), signal);
    return result;
}

ssize_t write(int fd, const void *data, size_t n) {
    REAL(ssize_t, "write", int, const void *, size_t);
    switch (fault(fd)) {
    case FAIL: return -1;
    case KILL: die();
    case SHORT: return real(fd, data, n > 1 ? n / 2 : n);
    case TORN: (void)!real(fd, data, n / 2); die();
    default: return real(fd, data, n);
    }
}

static ssize_t at(ssize_t (*real)(int, const void *, size_t, off_t), int fd, const void *data, size_t n, off_t where) {
    switch (fault(fd)) {
    case FAIL: return -1;
    case KILL: die();
    case SHORT: return real(fd, data, n > 1 ? n / 2 : n, where);
    case TORN: (void)!real(fd, data, n / 2, where); die();
    default: return real(fd, data, n, where);
    }
}

ssize_t pwrite(int fd, const void *data, size_t n, off_t where) {
    REAL(ssize_t, "pwrite", int, const void *, size_t, off_t);
    return at(real, fd, data, n, where);
}

ssize_t pwrite64(int fd, const void *data, size_t n, off_t where) {
    REAL(ssize_t, "pwrite64", int, const void *, size_t, off_t);
    return at(real, fd, data, n, where);
}

ssize_t writev(int fd, const struct iovec *parts, int count) {
    REAL(ssize_t, "writev", int, const struct iovec *, int);
    switch (fault(fd)) {
    case FAIL: return -1;
    case KILL: die();
    case SHORT: return write(fd, parts[0].iov_base, parts[0].iov_len / 2);
    case TORN: (void)!write(fd, parts[0].iov_base, parts[0].iov_len / 2); die();
    default: return real(fd, parts, count);
    }
}

static ssize_t vector(ssize_t (*real)(int, const struct iovec *, int, off_t), int fd, const struct iovec *parts, int count, off_t where) {
    struct iovec half = parts[0];
    half.iov_len = half.iov_len > 1 ? half.iov_len / 2 : half.iov_len;
    switch (fault(fd)) {
    case FAIL: return -1;
    case KILL: die();
    case SHORT: return real(fd, &half, 1, where);
    case TORN: (void)!real(fd, &half, 1, where); die();
    default: return real(fd, parts, count, where);
    }
}

ssize_t pwritev(int fd, const struct iovec *parts, int count, off_t where) {
    REAL(ssize_t, "pwritev", int, const struct iovec *, int, off_t);
    return vector(real, fd, parts, count, where);
}

ssize_t pwritev64(int fd, const struct iovec *parts, int count, off_t where) {
    REAL(ssize_t, "pwritev64", int, const struct iovec *, int, off_t);
    return vector(real, fd, parts, count, where);
}

static int simple(int fd) {
    switch (fault(fd)) {
    case FAIL: return -1;
    case KILL: case TORN: die();
    default: return 0;
    }
}

int ftruncate(int fd, off_t length) {
    REAL(int, "ftruncate", int, off_t);
    return simple(fd) ? -1 : real(fd, length);
}

int ftruncate64(int fd, off_t length) {
    REAL(int, "ftruncate64", int, off_t);
    return simple(fd) ? -1 : real(fd, length);
}

int fsync(int fd) {
    REAL(int, "fsync", int);
    return simple(fd) ? -1 : real(fd);
}

/* The descriptor is closed all the same. */
int close(int fd) {
    REAL(int, "close", int);
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    const char *kind = getenv("FAULT_KIND");
    long first = number("FAULT_CALL", 0), of_rank = number("FAULT_RANK", -1);
    int fails = 0;
    if (n >= 0 && kind && !strcmp(kind, "close-read") && (of_rank < 0 || of_rank == rank())) {
        path[n] = 0;
        if (concerned(path) && (fcntl(fd, F_GETFL) & (O_ACCMODE | O_DIRECTORY)) == O_RDONLY) {
            long close = atomic_fetch_add(&read_closes, 1) + 1;
            fails = first && close >= first && close - first < number("FAULT_CALLS", 1L << 40);
        }
    }
    if (n >= 0 && kind && !strcmp(kind, "close") && (of_rank < 0 || of_rank == rank())) {
        path[n] = 0;
        fails = concerned(path) && (fcntl(fd, F_GETFL) & O_ACCMODE) != O_RDONLY
            && atomic_load(&calls) >= first
            && atomic_fetch_add(&closes, 1) < number("FAULT_CALLS", 1L << 40);
    }
    int closed = real(fd);
    if (fails) errno = EIO;
    return fails ? -1 : closed;
}

/* A call that makes, renames or links a file. */
static int named(const char *path) {
    switch (fault_at(path)) {
    case FAIL: return -1;
    case KILL: case TORN: die();
    default: return 0;
    }
}

static int refused(const char *path) {
    const char *end = getenv("FAULT_OPEN");
    if (!end || strlen(path) < strlen(end) || strcmp(path + strlen(path) - strlen(end), end)) return 0;
    errno = EMFILE;
    return 1;
}

DIR *opendir(const char *path) {
    REAL(DIR *, "opendir", const char *);
    return refused(path) ? NULL : real(path);
}

#define OPEN(function) \
    int function(const char *path, int flags, ...) { \
        REAL(int, #function, const char *, int, ...); \
        va_list more; \
        va_start(more, flags); \
        int mode = flags & O_CREAT ? va_arg(more, int) : 0; \
        va_end(more); \
        if (refused(path)) return -1; \
        return flags & O_CREAT && named(path) ? -1 : real(path, flags, mode); \
    }

OPEN(open)
OPEN(open64)

int rename(const char *from, const char *to) {
    REAL(int, "rename", const char *, const char *);
    return named(to) ? -1 : real(from, to);
}

int linkat(int from_folder, const char *from, int to_folder, const char *to, int flags) {
    REAL(int, "linkat", int, const char *, int, const char *, int);
    return named(to) ? -1 : real(from_folder, from, to_folder, to, flags);
}

/* 0 where there are locks. */
static int without_locks(void) {
    return errno = number("FAULT_LOCKS", 0);
}

int flock(int fd, int how) {
    REAL(int, "flock", int, int);
    return without_locks() ? -1 : real(fd, how);
}

#define FCNTL(function) \
    int function(int fd, int what, ...) { \
        REAL(int, #function, int, int, ...); \
        va_list more; \
        va_start(more, what); \
        void *argument = va_arg(more, void *); \
        va_end(more); \
        int locks = what == F_SETLK || what == F_SETLKW || what == F_OFD_SETLK || what == F_OFD_SETLKW; \
        return locks && without_locks() ? -1 : real(fd, what, argument); \
    }

FCNTL(fcntl)
FCNTL(fcntl64)

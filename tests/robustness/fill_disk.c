/* A disk that becomes full: preloaded into a process, it lets so many changes of files below a folder pass, and refuses
   all further ones. Variables: FULL_BELOW, the folder; FULL_AFTER, changes that pass; FULL_COUNT, a file of 8 bytes that
   counts them, shared with the processes that this one starts. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

static const char *below;
static long after;
static long *count;

__attribute__((constructor)) static void begin(void) {
    const char *name = getenv("FULL_COUNT");
    below = getenv("FULL_BELOW");
    after = getenv("FULL_AFTER") ? atol(getenv("FULL_AFTER")) : -1;
    int (*open_)(const char *, int, ...) = dlsym(RTLD_NEXT, "open");
    int file = name ? open_(name, O_RDWR) : -1;
    void *shared = file < 0 ? MAP_FAILED : mmap(0, 8, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    count = shared == MAP_FAILED ? 0 : shared;
    if (file >= 0) close(file);
}

static int is_below(const char *path) {
    return below && path && !strncmp(path, below, strlen(below));
}

static int is_file_below(int file) {
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t n = below ? readlink(link, path, sizeof path - 1) : -1;
    if (n < 0) return 0;
    path[n] = 0;
    return is_below(path);
}

static int refused(void) {
    if (!count) return 0;
    if (__atomic_add_fetch(count, 1, __ATOMIC_SEQ_CST) <= after) return 0;
    errno = ENOSPC;
    return 1;
}

#define REAL(name) __typeof__(name) *real = dlsym(RTLD_NEXT, #name)

ssize_t write(int file, const void *from, size_t n) {
    REAL(write);
    return is_file_below(file) && refused() ? -1 : real(file, from, n);
}
ssize_t pwrite(int file, const void *from, size_t n, off_t at) {
    REAL(pwrite);
    return is_file_below(file) && refused() ? -1 : real(file, from, n, at);
}
ssize_t pwrite64(int file, const void *from, size_t n, off64_t at) {
    REAL(pwrite64);
    return is_file_below(file) && refused() ? -1 : real(file, from, n, at);
}
ssize_t writev(int file, const struct iovec *parts, int n) {
    REAL(writev);
    return is_file_below(file) && refused() ? -1 : real(file, parts, n);
}
int fsync(int file) {
    REAL(fsync);
    return is_file_below(file) && refused() ? -1 : real(file);
}
int mkdir(const char *path, mode_t mode) {
    REAL(mkdir);
    return is_below(path) && refused() ? -1 : real(path, mode);
}

#define OPEN(name, before, path, ...)                                        \
    before {                                                                         \
        mode_t mode = 0;                                                             \
        if (flags & O_CREAT) {                                                       \
            va_list more;                                                            \
            va_start(more, flags);                                                   \
            mode = va_arg(more, mode_t);                                             \
            va_end(more);                                                            \
        }                                                                            \
        REAL(name);                                                                  \
        if ((flags & O_CREAT) && is_below(path) && access(path, F_OK) && refused()) return -1; \
        return real(__VA_ARGS__, flags, mode);                                       \
    }
OPEN(open, int open(const char *path, int flags, ...), path, path)
OPEN(open64, int open64(const char *path, int flags, ...), path, path)
OPEN(openat, int openat(int at, const char *path, int flags, ...), path, at, path)
OPEN(openat64, int openat64(int at, const char *path, int flags, ...), path, at, path)

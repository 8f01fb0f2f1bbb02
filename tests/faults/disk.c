/* A disk that fails: the n-th write, fsync or rename below a folder gives an error, or a signal kills there.
   A full disk (ENOSPC) stays full; any other error comes once. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static char folder[PATH_MAX];
static long at = -1, seen = 0;
static int failure = 0;

void disk_fails(const char *below, long n, int error) {
    strncpy(folder, below, sizeof folder - 1);
    at = n, failure = error, seen = 0;
}
long disk_operations(void) { return seen; }

static int fails_path(const char *path) {
    if (at < 0 || strncmp(path, folder, strlen(folder)) != 0) return 0;
    if (++seen < at || (seen > at && failure != ENOSPC)) return 0;
    if (failure < 0) raise(-failure);
    errno = failure;
    return 1;
}
static int fails(int fd) {
    char link[64], path[PATH_MAX];
    if (at < 0) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    if (n <= 0) return 0;
    path[n] = 0;
    return fails_path(path);
}
#define REAL(f) static __typeof__(&f) real; if (!real) real = (__typeof__(&f))dlsym(RTLD_NEXT, #f)

ssize_t write(int fd, const void *b, size_t n) {
    REAL(write);
    return fails(fd) ? -1 : real(fd, b, n);
}
ssize_t writev(int fd, const struct iovec *v, int n) {
    REAL(writev);
    return fails(fd) ? -1 : real(fd, v, n);
}
ssize_t pwrite(int fd, const void *b, size_t n, off_t o) {
    REAL(pwrite);
    return fails(fd) ? -1 : real(fd, b, n, o);
}
ssize_t pwrite64(int fd, const void *b, size_t n, off64_t o) {
    REAL(pwrite64);
    return fails(fd) ? -1 : real(fd, b, n, o);
}
int fsync(int fd) {
    REAL(fsync);
    return fails(fd) ? -1 : real(fd);
}
int rename(const char *a, const char *b) {
    REAL(rename);
    return fails_path(b) ? -1 : real(a, b);
}
int renameat(int da, const char *a, int db, const char *b) {
    REAL(renameat);
    return fails_path(b) ? -1 : real(da, a, db, b);
}

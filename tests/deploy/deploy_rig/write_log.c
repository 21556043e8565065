/* For user-mode Linux, preloaded: appends every write to the file DISK to the file WRITE_LOG.
 *
 * A record (write_log.py reads it): offset and length in bytes, nanoseconds of CLOCK_MONOTONIC, each 64 bits, then the
 * written bytes. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

static ssize_t (*real_pwrite)(int, const void *, size_t, off64_t);
static struct stat disk;
static int out = -1;

__attribute__((constructor)) static void begin(void)
{
    *(void **)&real_pwrite = dlsym(RTLD_NEXT, "pwrite64");
    const char *const path = getenv("DISK"), *const log = getenv("WRITE_LOG");
    if (path && log && stat(path, &disk) == 0) out = open(log, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0644);
}

static void record(int fd, uint64_t offset, const void *data, size_t length)
{
    struct stat file;
    if (out < 0 || fstat(fd, &file) != 0 || file.st_ino != disk.st_ino || file.st_dev != disk.st_dev) return;
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    const uint64_t head[3] = {offset, length, now.tv_sec * 1000000000ULL + now.tv_nsec};
    const struct iovec parts[2] = {{(void *)head, sizeof head}, {(void *)data, length}};
    if (writev(out, parts, 2) != (ssize_t)(sizeof head + length)) _exit(1);
}

ssize_t pwrite64(int fd, const void *data, size_t length, off64_t offset)
{
    const ssize_t written = real_pwrite(fd, data, length, offset);
    if (written > 0) record(fd, offset, data, written);
    return written;
}

/* Makes one call of the program fail that changes a file of the journal: preloaded by disk.rs.
 * RIGD_FAIL_AT is the number of the call, from 1; RIGD_FAIL_FROM also fails every later one;
 * RIGD_FAIL_WITH is the number of the error. The number of calls goes to RIGD_FAIL_COUNT. While the file
 * RIGD_BLOCK_WHILE exists, the calls block. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static int is_journal(int fd) {
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return strstr(path, "/rigd.db") != NULL;
}

static int fails(int fd) {
    static int calls = 0;
    const char *at = getenv("RIGD_FAIL_AT"), *count = getenv("RIGD_FAIL_COUNT");
    const char *block = getenv("RIGD_BLOCK_WHILE");
    if (!is_journal(fd)) return 0;
    while (block && access(block, F_OK) == 0) usleep(10000);
    int call = __atomic_add_fetch(&calls, 1, __ATOMIC_SEQ_CST);
    if (count) {
        FILE *file = fopen(count, "w");
        if (file) { fprintf(file, "%d", call); fclose(file); }
    }
    if (!at) return 0;
    int wanted = atoi(at);
    if (call == wanted || (getenv("RIGD_FAIL_FROM") && call > wanted)) {
        errno = atoi(getenv("RIGD_FAIL_WITH"));
        return 1;
    }
    return 0;
}

#define NEXT(name) __typeof__(&name) next = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

ssize_t write(int fd, const void *data, size_t size) {
    NEXT(write);
    return fails(fd) ? -1 : next(fd, data, size);
}
ssize_t pwrite(int fd, const void *data, size_t size, off_t at) {
    NEXT(pwrite);
    return fails(fd) ? -1 : next(fd, data, size, at);
}
ssize_t pwrite64(int fd, const void *data, size_t size, off64_t at) {
    NEXT(pwrite64);
    return fails(fd) ? -1 : next(fd, data, size, at);
}
int fsync(int fd) {
    NEXT(fsync);
    return fails(fd) ? -1 : next(fd);
}
int fdatasync(int fd) {
    NEXT(fdatasync);
    return fails(fd) ? -1 : next(fd);
}
int ftruncate(int fd, off_t size) {
    NEXT(ftruncate);
    return fails(fd) ? -1 : next(fd, size);
}
int ftruncate64(int fd, off64_t size) {
    NEXT(ftruncate64);
    return fails(fd) ? -1 : next(fd, size);
}

/* For user-mode Linux 6.1 on processors with AMX, preloaded: the kernel outside takes a process's extended
 * registers (NT_X86_XSTATE) whole or not at all, and UML's buffer is smaller than they are there. What UML does
 * not know keeps its value. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/uio.h>

static long (*real)(enum __ptrace_request request, ...);
static char registers[1 << 16]; /* not on the stack: UML's are small; it calls ptrace from one thread */

__attribute__((constructor)) static void find_real(void)
{
    *(void **)&real = dlsym(RTLD_NEXT, "ptrace");
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    const pid_t pid = va_arg(arguments, pid_t);
    void *const kind = va_arg(arguments, void *);
    void *const data = va_arg(arguments, void *);
    va_end(arguments);
    if (request == PTRACE_SETREGSET && kind == (void *)NT_X86_XSTATE) {
        const struct iovec *const known = data;
        struct iovec all = {registers, sizeof registers};
        if (real(PTRACE_GETREGSET, pid, kind, &all) == 0 && known->iov_len < all.iov_len) {
            memcpy(registers, known->iov_base, known->iov_len);
            return real(request, pid, kind, &all);
        }
    }
    return real(request, pid, kind, data);
}

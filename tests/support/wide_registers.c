/* Lets Debian's `user-mode-linux` run on processors with more register state than it knows, such as
 * Intel's with AMX: preloaded into it (tests/support/kernel.rs).
 *
 * Linux takes the extended registers of a traced thread (NT_X86_XSTATE) as a whole only, and
 * refuses a shorter buffer with EFAULT; user-mode-linux 6.1 has 2,696 bytes for them. The bytes
 * beyond are those that the thread has: nothing inside uses them. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

long ptrace(enum __ptrace_request request, ...)
{
    /* Not on the stack: a kernel's is small. It has one thread, and does not trace in handlers. */
    static char whole[1 << 16] __attribute__((aligned(64)));
    static long (*next)(enum __ptrace_request, pid_t, void *, void *);
    va_list arguments;
    va_start(arguments, request);
    pid_t thread = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);
    if (next == NULL)
        next = dlsym(RTLD_NEXT, "ptrace");
    if (request == PTRACE_SETREGSET && (long)address == NT_X86_XSTATE) {
        struct iovec known = *(struct iovec *)data;
        struct iovec all = { whole, sizeof whole };
        if (next(PTRACE_GETREGSET, thread, address, &all) == 0 && known.iov_len < all.iov_len) {
            memcpy(whole, known.iov_base, known.iov_len);
            return next(request, thread, address, &all);
        }
    }
    return next(request, thread, address, data);
}

"""Tries what a plugin must not do, one after the other, and says of each whether it went well.

Reads `targets.json` beside it. Prints `succeeded NAME`, or `refused NAME: WHY`; at last `all was tried`.
"""
import ctypes
import errno
import fcntl
import json
import mmap
import os
import resource
import signal
import socket
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
TARGETS = json.load(open(os.path.join(HERE, "targets.json")))
LIBC = ctypes.CDLL(None, use_errno=True)
# Calls with the same number on every machine.
PIDFD_SEND_SIGNAL, IO_URING_SETUP, PIDFD_OPEN, PIDFD_GETFD, PROCESS_MADVISE = 424, 425, 434, 438, 440
FS_IOC_GETFLAGS, FS_IOC_SETFLAGS, NO_DUMP, IN_ALL_EVENTS = 0x80086601, 0x40086602, 0x40, 0xFFF
F_SETPIPE_SZ = 1031
CLONE_NEWUSER, CLONE_NEWNET, PTRACE_ATTACH, PTRACE_DETACH = 0x10000000, 0x40000000, 16, 17
VICTIM, INSIDE, PROCESS = TARGETS["victim"], TARGETS["inside"], TARGETS["process"]


def call(result):
    """The result of a C function, or its error."""
    if result == -1:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return result


def connect(address, family=socket.AF_UNIX, kind=socket.SOCK_STREAM):
    with socket.socket(family, kind) as client:
        client.connect(address)


def send_to(path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client:
        client.sendto(b"forged", path)


def empty(path, flags):
    os.close(os.open(path, flags | os.O_TRUNC))


def owner_of_signals():
    """Has the kernel signal another process when a pipe of ours can be read."""
    read, write = os.pipe()
    fcntl.fcntl(read, fcntl.F_SETOWN, PROCESS)
    os.close(read), os.close(write)


def trace():
    call(LIBC.ptrace(PTRACE_ATTACH, PROCESS, None, None))
    os.waitpid(PROCESS, 0x40000000)
    call(LIBC.ptrace(PTRACE_DETACH, PROCESS, None, None))


def read_memory():
    buffer = ctypes.create_string_buffer(8)

    class Vector(ctypes.Structure):
        _fields_ = [("base", ctypes.c_void_p), ("length", ctypes.c_size_t)]
    line = next(line for line in open(f"/proc/{PROCESS}/maps") if " r" in line)
    here = Vector(ctypes.addressof(buffer), 8)
    there = Vector(int(line.split("-")[0], 16), 8)
    call(LIBC.process_vm_readv(PROCESS, ctypes.byref(here), 1, ctypes.byref(there), 1, 0))


def process_file(number, *arguments):
    handle = call(LIBC.syscall(PIDFD_OPEN, PROCESS, 0))
    try:
        call(LIBC.syscall(number, handle, *arguments))
    finally:
        os.close(handle)


def in_child(attempt):
    """Tries it in a child, which it may leave in another namespace."""
    child = os.fork()
    if child == 0:
        try:
            attempt()
            os._exit(0)
        except OSError as error:
            os._exit(error.errno or 1)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code != 0:
        raise OSError(abs(code), os.strerror(abs(code)))


def namespaces(flags):
    in_child(lambda: call(LIBC.unshare(flags)))


def wider_socket():
    near, far = socket.socketpair()
    with near, far:
        near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 22)


def wider_pipe():
    read, write = os.pipe()
    try:
        fcntl.fcntl(write, F_SETPIPE_SZ, 1 << 20)
    finally:
        os.close(read), os.close(write)


def lent_pages():
    class Vector(ctypes.Structure):
        _fields_ = [("base", ctypes.c_void_p), ("length", ctypes.c_size_t)]
    read, write = os.pipe()
    page = ctypes.create_string_buffer(4096)
    try:
        call(LIBC.vmsplice(write, ctypes.byref(Vector(ctypes.addressof(page), 4096)), 1, 0))
    finally:
        os.close(read), os.close(write)


def shared_memory():
    identifier = call(LIBC.shmget(0, 4096, 0o1600))
    LIBC.shmctl(identifier, 0, None)


def memory_of_zero():
    file = os.open("/dev/zero", os.O_RDWR)
    try:
        mmap.mmap(file, mmap.PAGESIZE, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE).close()
    finally:
        os.close(file)


def set_flags(path):
    """Sets a flag of a file that is open to be read only."""
    file = os.open(path, os.O_RDONLY)
    try:
        flags = bytearray(8)
        fcntl.ioctl(file, FS_IOC_GETFLAGS, flags)
        flags[0] |= NO_DUMP
        fcntl.ioctl(file, FS_IOC_SETFLAGS, flags)
    finally:
        os.close(file)


def watch(path):
    queue = call(LIBC.inotify_init())
    try:
        call(LIBC.inotify_add_watch(queue, path.encode(), IN_ALL_EVENTS))
    finally:
        os.close(queue)


def device():
    path = os.path.join(os.environ.get("HOME", "/tmp"), "disk")
    os.mknod(path, 0o600 | 0o060000, os.makedev(7, 0))
    os.unlink(path)


def write_new(path):
    with open(path, "w") as file:
        file.write("left behind")
    os.unlink(path)


ATTACKS = {
    "overhears-a-daemon": lambda: [connect(path) for path in TARGETS["sockets"]],
    "connects-by-a-link": lambda: (
        os.symlink(TARGETS["sockets"][0], os.path.join(os.environ["HOME"], "link")),
        connect(os.path.join(os.environ["HOME"], "link"))),
    "connects-in-a-folder-that-it-reads": lambda: connect(TARGETS["shared"]),
    "connects-to-a-name": lambda: connect("\0" + TARGETS["name"]),
    "connects-over-tcp": lambda: connect(("127.0.0.1", TARGETS["port"]), socket.AF_INET),
    "sends-a-datagram": lambda: send_to(TARGETS["datagram"]),
    "reads-a-key": lambda: open(VICTIM).close(),
    "writes-a-key": lambda: open(VICTIM, "a").close(),
    "truncates-a-key": lambda: os.truncate(VICTIM, 1),
    "empties-a-key-by-reading": lambda: empty(VICTIM, os.O_RDONLY),
    "empties-a-key-by-neither": lambda: empty(VICTIM, 3),
    "changes-the-mode-of-a-key": lambda: os.chmod(VICTIM, 0o666),
    "changes-the-times-of-a-key": lambda: os.utime(VICTIM, (0, 0)),
    "watches-a-key": lambda: watch(VICTIM),
    "attributes-of-a-key": lambda: os.listxattr(VICTIM),
    "links-a-key": lambda: os.link(VICTIM, os.path.join(os.environ["HOME"], "key")),
    "removes-a-key": lambda: os.unlink(VICTIM),
    "truncates-its-package": lambda: os.truncate(INSIDE, 1),
    "empties-its-package-by-reading": lambda: empty(INSIDE, os.O_RDONLY),
    "empties-its-package-by-neither": lambda: empty(INSIDE, 3),
    "changes-the-mode-of-its-package": lambda: os.chmod(INSIDE, 0o666),
    "changes-the-times-of-its-package": lambda: os.utime(INSIDE, (0, 0)),
    "attributes-of-its-package": lambda: os.setxattr(INSIDE, "user.forged", b"1"),
    "flags-of-its-package": lambda: set_flags(INSIDE),
    "leaves-a-file": lambda: write_new(os.path.join(TARGETS["folder"], "left")),
    "leaves-shared-memory": lambda: write_new("/dev/shm/althing-attack"),
    "signals": lambda: os.kill(PROCESS, signal.SIGCONT),
    "signals-by-a-file": lambda: process_file(PIDFD_SEND_SIGNAL, signal.SIGCONT, None, 0),
    "signals-by-a-pipe": owner_of_signals,
    "limits-a-process": lambda: resource.prlimit(PROCESS, resource.RLIMIT_CORE, (0, 0)),
    "moves-a-process": lambda: os.sched_setaffinity(PROCESS, os.sched_getaffinity(0)),
    "slows-a-process": lambda: os.setpriority(os.PRIO_PROCESS, PROCESS, 1),
    "traces-a-process": trace,
    "reads-the-memory-of-a-process": read_memory,
    "reads-the-environment-of-a-process": lambda: open(f"/proc/{PROCESS}/environ", "rb").read(),
    "takes-a-file-of-a-process": lambda: process_file(PIDFD_GETFD, 0, 0),
    "leaves-its-group": lambda: in_child(os.setsid),
    "makes-namespaces-of-users": lambda: namespaces(CLONE_NEWUSER),
    "makes-namespaces-of-networks": lambda: namespaces(CLONE_NEWUSER | CLONE_NEWNET),
    "uses-a-ring": lambda: os.close(call(LIBC.syscall(IO_URING_SETUP, 1, ctypes.create_string_buffer(120)))),
    "opens-a-socket-of-udp": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).close(),
    "opens-a-socket-of-tcp": lambda: socket.socket(socket.AF_INET6, socket.SOCK_STREAM).close(),
    "opens-a-socket-of-netlink": lambda: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW).close(),
    "holds-memory-without-a-name": lambda: os.close(os.memfd_create("hidden")),
    "holds-memory-that-it-shares": lambda: mmap.mmap(-1, mmap.PAGESIZE).close(),
    "holds-memory-of-zero": memory_of_zero,
    "enlarges-the-buffer-of-a-socket": wider_socket,
    "enlarges-the-buffer-of-a-pipe": wider_pipe,
    "lends-pages-to-a-pipe": lent_pages,
    "shares-memory": shared_memory,
    "makes-a-device": device,
}

# What a plugin may do all the same: a confinement in which nothing works proves nothing.
RIGHTS = {
    "writes-at-home": lambda: write_new(os.path.join(os.environ["HOME"], "own")),
    "reads-its-package": lambda: open(INSIDE).read(),
    "reads-what-it-was-given": lambda: os.stat(TARGETS["shared"]),
    "signals-its-child": lambda: own_child(),
    "signals-itself": lambda: os.kill(os.getpid(), signal.SIGCONT),
    "pairs-sockets": lambda: [end.close() for end in socket.socketpair()],
}


def own_child():
    child = os.fork()
    if child == 0:
        signal.pause()
    os.kill(child, signal.SIGTERM)
    if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != -signal.SIGTERM:
        raise OSError(errno.EPERM, "the child lives")


def attempt(name, what):
    try:
        what()
        print("succeeded", name, flush=True)
    except OSError as error:
        print(f"refused {name}: {errno.errorcode.get(error.errno, error.errno)}", flush=True)


if __name__ == "__main__":
    wanted = sys.argv[1:] or list(ATTACKS)
    for name in wanted:
        attempt(name, ATTACKS[name])
    for name, what in RIGHTS.items():
        attempt(name, what)
    print("all was tried", flush=True)
    sys.exit(7)

//! Filters of the system calls that a plugin may make (seccomp).
//!
//! - [`ALLOWED`] are the calls that programs in any language need. All other calls fail with
//!   `ENOSYS`, also those of later kernels. Programs take `ENOSYS` to mean that the kernel does not
//!   have the call, and then work without the call.
//! - [`FORBIDDEN`] calls fail with “Operation not permitted”. Allowed calls fail in the same way if
//!   their arguments reach beyond the plugin: another process, a namespace, a device node, a socket
//!   of another family.
//! - If the kernel has no other means, calls that connect a socket, signal a process or start a
//!   process wait for the daemon's answer (`mediator`).

use std::collections::BTreeMap;
use std::str::FromStr as _;

use seccompiler::{
    BackendError, BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition,
    SeccompFilter, SeccompRule, TargetArch,
};
use syscalls::Sysno;

/// System calls that programs in any language need. Names that do not exist on this architecture
/// are left out.
const ALLOWED: &str = "
    read write readv writev pread64 pwrite64 preadv pwritev preadv2 pwritev2 lseek _llseek
    sendfile sendfile64 splice tee vmsplice copy_file_range readahead fadvise64 fadvise64_64
    close close_range dup dup2 dup3 fcntl fcntl64 ioctl flock pipe pipe2 fallocate
    fsync fdatasync sync_file_range
    open openat creat access faccessat faccessat2 stat fstat lstat newfstatat statx stat64 fstat64
    lstat64 fstatat64 readlink readlinkat getdents getdents64 getcwd chdir fchdir umask
    statfs fstatfs statfs64 fstatfs64
    mkdir mkdirat rmdir unlink unlinkat rename renameat renameat2 link linkat symlink symlinkat
    mknod mknodat truncate truncate64 ftruncate ftruncate64
    chmod fchmod fchmodat chown fchown lchown fchownat chown32 fchown32 lchown32
    utime utimes futimesat utimensat utimensat_time64
    getxattr lgetxattr fgetxattr listxattr llistxattr flistxattr
    setxattr lsetxattr fsetxattr removexattr lremovexattr fremovexattr
    inotify_init inotify_init1 inotify_add_watch inotify_rm_watch
    mmap mmap2 munmap mremap mprotect brk madvise mincore msync mlock mlock2 munlock mlockall
    munlockall membarrier pkey_alloc pkey_free pkey_mprotect memfd_create
    clone fork vfork execve execveat exit exit_group wait4 waitid waitpid
    kill tkill tgkill rt_sigqueueinfo rt_tgsigqueueinfo
    getpid getppid gettid getpgid getpgrp getsid
    getuid geteuid getgid getegid getresuid getresgid getgroups
    getuid32 geteuid32 getgid32 getegid32 getresuid32 getresgid32 getgroups32
    setuid setgid setreuid setregid setresuid setresgid setfsuid setfsgid setgroups
    setuid32 setgid32 setreuid32 setregid32 setresuid32 setresgid32 setfsuid32 setfsgid32
    capget capset prctl arch_prctl personality seccomp
    landlock_create_ruleset landlock_add_rule landlock_restrict_self
    prlimit64 getrlimit ugetrlimit setrlimit getrusage times sysinfo uname
    getpriority setpriority ioprio_get ioprio_set getcpu
    sched_yield sched_getaffinity sched_setaffinity sched_getparam sched_setparam
    sched_getscheduler sched_setscheduler sched_getattr sched_setattr
    sched_get_priority_max sched_get_priority_min sched_rr_get_interval
    sched_rr_get_interval_time64
    set_tid_address set_robust_list get_robust_list rseq set_thread_area get_thread_area set_tls
    cacheflush riscv_flush_icache riscv_hwprobe
    futex futex_time64 futex_waitv futex_wait futex_wake futex_requeue
    rt_sigaction rt_sigprocmask rt_sigpending rt_sigreturn rt_sigsuspend rt_sigtimedwait
    rt_sigtimedwait_time64 sigaltstack sigreturn signalfd signalfd4 pause restart_syscall
    nanosleep clock_nanosleep clock_nanosleep_time64 clock_gettime clock_gettime64 clock_getres
    clock_getres_time64 gettimeofday time alarm getitimer setitimer
    timer_create timer_settime timer_gettime timer_getoverrun timer_delete timer_settime64
    timer_gettime64 timerfd_create timerfd_settime timerfd_gettime timerfd_settime64
    timerfd_gettime64
    epoll_create epoll_create1 epoll_ctl epoll_wait epoll_pwait epoll_pwait2 poll ppoll
    ppoll_time64 select _newselect pselect6 pselect6_time64 eventfd eventfd2
    socket socketpair connect bind listen accept accept4 getsockname getpeername getsockopt
    setsockopt sendto send sendmsg sendmmsg recvfrom recv recvmsg recvmmsg recvmmsg_time64 shutdown
    getrandom";

/// System calls that fail with “Operation not permitted” instead of `ENOSYS`, so that a person sees
/// why a program fails.
const FORBIDDEN: &str = "
    acct add_key bpf chroot clock_adjtime clock_settime delete_module finit_module init_module
    io_uring_enter io_uring_register io_uring_setup kcmp kexec_load keyctl migrate_pages mount
    move_pages mq_open msgctl msgget msgrcv msgsnd open_by_handle_at perf_event_open pidfd_getfd
    pidfd_send_signal pivot_root process_madvise process_mrelease process_vm_readv process_vm_writev
    ptrace quotactl reboot request_key semctl semget semop semtimedop setns settimeofday shmat shmctl
    shmdt shmget swapoff swapon umount2 unshare userfaultfd
    setpgid setsid";

/// System calls that change metadata of a file. Landlock does not control them, so they are
/// forbidden unless mounts protect the files.
const METADATA: &str = "
    chmod fchmod fchmodat chown fchown lchown fchownat chown32 fchown32 lchown32
    utime utimes futimesat utimensat utimensat_time64
    setxattr lsetxattr fsetxattr removexattr lremovexattr fremovexattr";

/// System call that watches a path. A watch reports when a file is opened, read or written, and
/// Landlock does not control watches. Therefore the call is forbidden unless mounts hide the files
/// of others.
const WATCHES: &str = "inotify_add_watch";

/// System calls that read the extended attributes of a file by its path, even if Landlock hides the
/// file. Unless mounts hide the files of others, these calls fail with `ENOTSUP`, as on a file
/// system without extended attributes. Programs expect this error and work without attributes.
const ATTRIBUTES: &str = "getxattr lgetxattr listxattr llistxattr";

/// System calls that change a property of the process with a given number; 0 is the calling
/// process.
const ABOUT_PROCESSES: &str =
    "prlimit64 sched_setaffinity sched_setparam sched_setscheduler sched_setattr";

/// System calls that signal the process or thread with a given number.
const SIGNALS: &str = "kill tkill tgkill rt_sigqueueinfo rt_tgsigqueueinfo";

/// Flags of `clone` that a plugin may not use: those that create namespaces, and `CLONE_PARENT`,
/// which makes the new process a child of the daemon without the daemon's knowledge.
const CLONE_FLAGS: &[i32] = &[
    libc::CLONE_NEWNS,
    libc::CLONE_NEWCGROUP,
    libc::CLONE_NEWUTS,
    libc::CLONE_NEWIPC,
    libc::CLONE_NEWUSER,
    libc::CLONE_NEWPID,
    libc::CLONE_NEWNET,
    libc::CLONE_PARENT,
];

/// Commands of `fcntl` that a plugin may not use. Some choose the process that receives a file's
/// signals. Others are for leases and notifications, which delay or observe other processes that
/// open the file.
const FCNTL: &[i32] = &[F_SETOWN, F_SETOWN_EX, F_SETSIG, libc::F_SETLEASE, libc::F_NOTIFY];
const F_SETOWN: i32 = 8;
const F_SETSIG: i32 = 10;
const F_SETOWN_EX: i32 = 15;

/// Requests of `ioctl` that a plugin may not use: those that choose the process that receives the
/// signals of a socket or terminal, and those that insert input into a terminal.
const IOCTL: &[u64] = &[FIOSETOWN, SIOCSPGRP, TIOCSTI, TIOCLINUX];
const FIOSETOWN: u64 = 0x8901;
const SIOCSPGRP: u64 = 0x8902;
const TIOCSTI: u64 = 0x5412;
const TIOCLINUX: u64 = 0x541c;

/// Types of `ioctl` requests that read or set metadata of an open file, or act on the whole file
/// system of the file: flags such as “immutable”, encryption, quotas, freezing, snapshots. Only a
/// mount protects files from these requests. Programs that query the flags can do without the
/// answer. Requests about sockets, pipes and terminals have other types ('T', 0x89), and so do
/// those of device drivers.
const IOCTL_OF_FILES: &[u8] = b"fXv";
/// Type of the `ioctl` requests of Btrfs, which act on files and file systems like those of
/// [`IOCTL_OF_FILES`]. `FICLONE` and `FICLONERANGE` have this type, but are allowed: all file
/// systems have them, they copy only into a file that may be written, and programs do not expect
/// the error “Operation not permitted”.
const IOCTL_OF_BTRFS: u8 = 0x94;
const FICLONE: u64 = 0x4004_9409;
const FICLONERANGE: u64 = 0x4020_940d;
/// Position of the type in the number of an `ioctl` request, in bits (`_IOC_TYPESHIFT`).
const IOCTL_TYPE_SHIFT: u32 = 8;

/// Argument of `ioprio_set` that means a single process (`IOPRIO_WHO_PROCESS`).
const IOPRIO_PROCESS: u64 = 1;
/// Argument of `personality` with which the call only queries and changes nothing.
const ASK_PERSONALITY: u64 = 0xffff_ffff;
/// Mask that selects the type of a socket, without the flags of the socket (`SOCK_TYPE_MASK`).
const SOCKET_TYPE: u64 = 0xf;

/// Properties of a plugin's confinement that decide which system calls are forbidden.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CallFilterOptions {
    /// Whether the plugin may use sockets of the Internet.
    pub(super) network: bool,
    /// Whether mounts protect the files that the plugin may not change.
    pub(super) has_own_mounts: bool,
    /// Whether the kernel restricts `truncate` to files that the plugin may write.
    pub(super) truncates_own_only: bool,
    /// Whether a control group counts the memory of the plugin, also memory that belongs to no
    /// process.
    pub(super) counts_memory: bool,
}

/// Reason why the filters of system calls could not be installed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CallsError {
    /// A filter of system calls could not be compiled.
    #[error("make a filter of calls: {0}")]
    Compile(#[from] BackendError),
    /// The kernel did not accept a filter of system calls.
    #[error("forbid calls: {0}")]
    Install(#[from] seccompiler::Error),
}

type CallRules = BTreeMap<i64, Vec<SeccompRule>>;

/// Returns the architecture of this machine, or `None` if no filters of system calls can be made
/// for it.
pub(super) fn target() -> Option<TargetArch> {
    std::env::consts::ARCH.try_into().ok()
}

/// Installs the filters of system calls for this thread; they cannot be removed.
pub(super) fn forbid(choice: CallFilterOptions, target: TargetArch) -> Result<(), CallsError> {
    let errno = |number: i32| SeccompAction::Errno(number.unsigned_abs());
    let known = numbers(ALLOWED).map(|call| (call, Vec::new())).collect();
    let allowed = SeccompFilter::new(known, errno(libc::ENOSYS), SeccompAction::Allow, target)?;
    let forbidden =
        SeccompFilter::new(forbidden(choice)?, SeccompAction::Allow, errno(libc::EPERM), target)?;
    let mut filters = vec![allowed, forbidden];
    if !choice.has_own_mounts {
        let rules = numbers(ATTRIBUTES).map(|call| (call, Vec::new())).collect();
        let none = errno(libc::ENOTSUP);
        filters.push(SeccompFilter::new(rules, SeccompAction::Allow, none, target)?);
    }
    // If two filters return different errors, the error of the filter that was installed last
    // applies.
    for filter in filters {
        let program: BpfProgram = filter.try_into()?;
        seccompiler::apply_filter(&program)?;
    }
    Ok(())
}

/// Returns the filter for the system calls that the daemon answers: those that connect a socket,
/// those that signal a process other than `own`, and, with `counts_processes`, those that start a
/// process.
pub(super) fn mediated(
    counts_processes: bool,
    own: u32,
    target: TargetArch,
) -> Result<BpfProgram, CallsError> {
    let mut rules = CallRules::new();
    rules.extend(numbers("connect").map(|call| (call, Vec::new())));
    for call in SIGNALS.split_whitespace() {
        // Programs signal themselves often, for example in `abort` and in runtimes.
        add(&mut rules, call, vec![vec![is_not(0, own.into())?]]);
    }
    if counts_processes {
        let thread = libc::CLONE_THREAD.unsigned_abs().into();
        add(&mut rules, "clone", vec![vec![masked(0, thread, 0)?]]);
        rules.extend(numbers("fork vfork").map(|call| (call, Vec::new())));
    }
    Ok(seccomp_notify::program(rules, target)?)
}

fn forbidden(choice: CallFilterOptions) -> Result<CallRules, BackendError> {
    let mut rules: CallRules = numbers(FORBIDDEN).map(|call| (call, Vec::new())).collect();
    if !choice.has_own_mounts {
        rules.extend(numbers(METADATA).map(|call| (call, Vec::new())));
        rules.extend(numbers(WATCHES).map(|call| (call, Vec::new())));
        add(&mut rules, "ioctl", requests_of_files()?);
    }
    if !choice.truncates_own_only {
        rules.extend(numbers("truncate truncate64").map(|call| (call, Vec::new())));
    }
    if !choice.counts_memory {
        rules.extend(numbers("memfd_create").map(|call| (call, Vec::new())));
        // Pages that are lent to a pipe stay in memory when the process has given them back.
        rules.extend(numbers("vmsplice").map(|call| (call, Vec::new())));
        larger_buffers(&mut rules)?;
        // Shared anonymous pages are not limited as data of the process. When the process gives
        // them back (`MADV_DONTNEED`), they stay in memory, but outside of its resident set.
        let shared = (libc::MAP_SHARED | libc::MAP_ANONYMOUS).unsigned_abs().into();
        for call in ["mmap", "mmap2"] {
            add(&mut rules, call, vec![vec![masked(3, shared, shared)?]]);
        }
    }
    sockets(&mut rules, choice.network)?;
    processes(&mut rules)?;
    files(&mut rules)?;
    Ok(rules)
}

/// Forbids to enlarge the buffers of sockets and pipes, which hold memory that belongs to no
/// process. The daemon counts buffers of the default size (`buffers`).
fn larger_buffers(rules: &mut CallRules) -> Result<(), BackendError> {
    let level = u64::from(libc::SOL_SOCKET.unsigned_abs());
    let mut options = Vec::new();
    for option in [libc::SO_SNDBUF, libc::SO_SNDBUFFORCE, libc::SO_RCVBUFFORCE] {
        options.push(vec![is(1, level)?, is(2, u64::from(option.unsigned_abs()))?]);
    }
    add(rules, "setsockopt", options);
    for call in ["fcntl", "fcntl64"] {
        add(rules, call, vec![vec![is(1, u64::from(libc::F_SETPIPE_SZ.unsigned_abs()))?]]);
    }
    Ok(())
}

/// Forbids sockets of families that the plugin may not use. Also forbids Unix sockets without a
/// connection, because they reach any socket with a known address.
fn sockets(rules: &mut CallRules, network: bool) -> Result<(), BackendError> {
    let mut families = vec![libc::AF_UNIX];
    if network {
        // Libraries ask the kernel for the machine's addresses over netlink.
        families.extend([libc::AF_INET, libc::AF_INET6, libc::AF_NETLINK]);
    }
    let family = |family: i32| u64::from(family.unsigned_abs());
    let others =
        families.iter().map(|known| is_not(0, family(*known))).collect::<Result<_, _>>()?;
    let mut bad: Vec<Vec<SeccompCondition>> = vec![others];
    for kind in [libc::SOCK_DGRAM, libc::SOCK_RAW, libc::SOCK_RDM, libc::SOCK_DCCP, 10] {
        let kind = u64::from(kind.unsigned_abs());
        bad.push(vec![is(0, family(libc::AF_UNIX))?, masked(1, SOCKET_TYPE, kind)?]);
    }
    add(rules, "socketpair", bad.clone());
    let netlink = u64::from(libc::NETLINK_ROUTE.unsigned_abs());
    bad.push(vec![is(0, family(libc::AF_NETLINK))?, is_not(2, netlink)?]);
    add(rules, "socket", bad);
    Ok(())
}

/// Forbids system calls that affect other processes, or that hide this process from the daemon.
fn processes(rules: &mut CallRules) -> Result<(), BackendError> {
    for call in ABOUT_PROCESSES.split_whitespace() {
        add(rules, call, vec![vec![is_not(0, 0)?]]);
    }
    let itself = libc::PRIO_PROCESS.into();
    add(rules, "setpriority", vec![vec![is_not(0, itself)?], vec![is_not(1, 0)?]]);
    add(rules, "ioprio_set", vec![vec![is_not(0, IOPRIO_PROCESS)?], vec![is_not(1, 0)?]]);
    let flags = CLONE_FLAGS.iter().map(|flag| u64::from(flag.unsigned_abs()));
    let flags = flags.map(|flag| Ok(vec![masked(0, flag, flag)?]));
    add(rules, "clone", flags.collect::<Result<_, BackendError>>()?);
    let option = |option: i32| u64::from(option.unsigned_abs());
    // A process that is not dumpable hides its open files and memory from other processes of its
    // user, such as the daemon.
    let hidden = vec![is(0, option(libc::PR_SET_DUMPABLE))?, is_not(1, 1)?];
    add(rules, "prctl", vec![hidden, vec![is(0, option(libc::PR_SCHED_CORE))?]]);
    let others = vec![is_not(0, 0)?, is_not(0, ASK_PERSONALITY)?];
    add(rules, "personality", vec![others]);
    Ok(())
}

fn files(rules: &mut CallRules) -> Result<(), BackendError> {
    let fcntl = FCNTL.iter().map(|command| Ok(vec![is(1, u64::from(command.unsigned_abs()))?]));
    let fcntl = fcntl.collect::<Result<Vec<_>, BackendError>>()?;
    add(rules, "fcntl", fcntl.clone());
    add(rules, "fcntl64", fcntl);
    let ioctl = IOCTL.iter().map(|command| Ok(vec![is(1, *command)?]));
    add(rules, "ioctl", ioctl.collect::<Result<_, BackendError>>()?);
    // `O_TRUNC` empties a file even if it is opened for reading only, or with the fourth access
    // mode (neither reading nor writing), for which Landlock requires no right.
    let mask = (libc::O_ACCMODE | libc::O_TRUNC).unsigned_abs().into();
    for (call, index) in [("open", 1), ("openat", 2)] {
        let empties = [libc::O_RDONLY, libc::O_ACCMODE].map(|mode| mode | libc::O_TRUNC);
        let empties =
            empties.map(|flags| Ok(vec![masked(index, mask, flags.unsigned_abs().into())?]));
        add(rules, call, empties.into_iter().collect::<Result<_, BackendError>>()?);
    }
    for (call, index) in [("mknod", 1), ("mknodat", 2)] {
        let kinds = [libc::S_IFCHR, libc::S_IFBLK].map(u64::from);
        let kinds = kinds.map(|kind| Ok(vec![masked(index, u64::from(libc::S_IFMT), kind)?]));
        add(rules, call, kinds.into_iter().collect::<Result<_, BackendError>>()?);
    }
    Ok(())
}

/// Returns the conditions that match `ioctl` requests which read or set metadata of a file.
fn requests_of_files() -> Result<Vec<Vec<SeccompCondition>>, BackendError> {
    let is_of = |kind: u8| {
        let mask = u64::from(u8::MAX) << IOCTL_TYPE_SHIFT;
        masked(1, mask, u64::from(kind) << IOCTL_TYPE_SHIFT)
    };
    let mut any = Vec::new();
    for kind in IOCTL_OF_FILES {
        any.push(vec![is_of(*kind)?]);
    }
    any.push(vec![is_of(IOCTL_OF_BTRFS)?, is_not(1, FICLONE)?, is_not(1, FICLONERANGE)?]);
    Ok(any)
}

/// Forbids a system call if one of the conditions `any` holds. A call that is already forbidden
/// under all conditions stays so.
fn add(rules: &mut CallRules, call: &str, any: Vec<Vec<SeccompCondition>>) {
    let Some(call) = known(call) else { return };
    let added: Result<Vec<_>, _> = any.into_iter().map(SeccompRule::new).collect();
    let added = added.expect("invariant: no rule is without a condition");
    match rules.get_mut(&call) {
        Some(always) if always.is_empty() => (),
        Some(rules) => rules.extend(added),
        None => drop(rules.insert(call, added)),
    }
}

fn is(index: u8, value: u64) -> Result<SeccompCondition, BackendError> {
    SeccompCondition::new(index, SeccompCmpArgLen::Dword, SeccompCmpOp::Eq, value)
}

fn is_not(index: u8, value: u64) -> Result<SeccompCondition, BackendError> {
    SeccompCondition::new(index, SeccompCmpArgLen::Dword, SeccompCmpOp::Ne, value)
}

fn masked(index: u8, mask: u64, value: u64) -> Result<SeccompCondition, BackendError> {
    SeccompCondition::new(index, SeccompCmpArgLen::Dword, SeccompCmpOp::MaskedEq(mask), value)
}

/// Returns the numbers of the system calls with these names; names that this architecture does not
/// have are left out.
fn numbers(names: &str) -> impl Iterator<Item = i64> {
    names.split_whitespace().filter_map(known)
}

fn known(name: &str) -> Option<i64> {
    Sysno::from_str(name).ok().map(|call| i64::from(call.id()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn call_names_exist_and_none_is_both_allowed_and_forbidden() {
        let has = |list: &str, name: &str| list.split_whitespace().any(|known| known == name);
        let both = FORBIDDEN.split_whitespace().find(|name| has(ALLOWED, name));
        assert_eq!(both, None);
        for list in [METADATA, WATCHES, ATTRIBUTES, ABOUT_PROCESSES, SIGNALS] {
            let stray = list.split_whitespace().find(|name| !has(ALLOWED, name));
            assert_eq!(stray, None, "it is forbidden anyway");
        }
        // A misspelt name would forbid nothing.
        let misspelt = FORBIDDEN.split_whitespace().find(|name| known(name).is_none());
        assert!(misspelt.is_none() || cfg!(not(target_arch = "x86_64")), "{misspelt:?}");
    }

    #[test]
    fn filters_fit_into_the_kernels_bound() {
        let Some(target) = target() else { return };
        let choice = CallFilterOptions {
            network: false,
            has_own_mounts: false,
            truncates_own_only: false,
            counts_memory: false,
        };
        let rules = forbidden(choice).expect("rules");
        let action = SeccompAction::Errno(1);
        let filter = SeccompFilter::new(rules, SeccompAction::Allow, action, target);
        let program: BpfProgram = filter.expect("a filter").try_into().expect("it compiles");
        assert!(program.len() < 4_096, "{}", program.len());
        assert!(mediated(true, 7, target).expect("it compiles").len() < 4_096);
    }

    #[test]
    fn shared_memory_is_forbidden_only_if_it_is_not_counted() {
        for counts_memory in [true, false] {
            let choice = CallFilterOptions {
                network: false,
                has_own_mounts: true,
                truncates_own_only: true,
                counts_memory,
            };
            let rules = forbidden(choice).expect("rules");
            let call = known("mmap").expect("every machine has it");
            // Only under conditions, because programs map files and private memory.
            let is_conditional = rules.get(&call).is_some_and(|rules| !rules.is_empty());
            assert_eq!(is_conditional, !counts_memory);
            assert_eq!(rules.contains_key(&call), !counts_memory);
        }
    }

    #[test]
    fn calls_about_hidden_files_fail_without_own_mounts() {
        use rustix::fs::inotify::{CreateFlags, WatchFlags, add_watch, init};
        use rustix::io::Errno;
        let Some(target) = target() else { return };
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().to_owned();
        // A filter applies to the thread that installed it, and ends with the thread.
        let confined = std::thread::spawn(move || {
            rustix::thread::set_no_new_privs(true).expect("the kernel lets everybody");
            let choice = CallFilterOptions {
                network: false,
                has_own_mounts: false,
                truncates_own_only: true,
                counts_memory: true,
            };
            forbid(choice, target).expect("filters");
            let file = std::fs::File::open(&path).expect("a folder");
            let watch = init(CreateFlags::CLOEXEC).expect("nothing is watched yet");
            (
                add_watch(&watch, &path, WatchFlags::ALL_EVENTS).err(),
                rustix::fs::listxattr(&path, &mut [0_u8; 64]).err(),
                rustix::fs::ioctl_getflags(&file).err(),
                rustix::fs::ioctl_ficlone(&file, &file).err() != Some(Errno::PERM),
            )
        });
        let expected = (Some(Errno::PERM), Some(Errno::NOTSUP), Some(Errno::PERM), true);
        assert_eq!(confined.join().expect("it ends"), expected);
    }
}

//! Namespace room of a plugin's process: Linux namespaces of users, mounts and System V IPC, and,
//! for a plugin without the right `network`, of networks (namespaces(7)).
//!
//! The room holds only the files that the plugin may see. Everything is mounted read-only except
//! the plugin's data folder. Contents, modes, times and attributes of other files therefore cannot
//! change. The only sockets in the room are those that the plugin may connect to, and a network
//! namespace has no network interface. The user is the same as outside, without capabilities.

use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

use nix::sched::{CloneFlags, unshare};
use rustix::fs::StatVfsMountFlags;
use rustix::mount::{
    MountFlags, MountPropagationFlags, UnmountFlags, mount, mount_bind_recursive, mount_change,
    mount_remount, unmount,
};

/// Mount point of the machine's root while the namespace room is made.
const OLD: &str = "/old";
/// Path of the namespace room's root until the room is entered.
const NEW: &str = "/new";

/// Number of symbolic links that are followed in one path; a path with more links counts as a
/// cycle.
const LINKS_MAX: usize = 64;

/// Symbolic links in the namespace room to the open files of each process, which shells and
/// interpreters use: path of the link, and its target.
const OPEN_FILES: [(&str, &str); 4] = [
    ("/dev/fd", "/proc/self/fd"),
    ("/dev/stdin", "/proc/self/fd/0"),
    ("/dev/stdout", "/proc/self/fd/1"),
    ("/dev/stderr", "/proc/self/fd/2"),
];

/// Contents of a namespace room: the files, devices, sockets and network that one package can use.
#[derive(Clone, Debug, Default)]
pub(super) struct RoomContents {
    /// Files and folders that are visible in the room, at the same path as outside. Paths that do
    /// not exist are left out.
    pub(super) shown: Vec<PathBuf>,
    /// Devices of the room, which can be opened for writing.
    pub(super) devices: Vec<PathBuf>,
    /// Sockets of the room that can be connected to.
    pub(super) sockets: Vec<PathBuf>,
    /// The only folder of the room with write access; `/tmp` links to it.
    pub(super) home: PathBuf,
    /// Whether the network of this machine is available in the room.
    pub(super) network: bool,
}

/// Reason why a namespace room could not be entered. The text of the error completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[error("{doing}: {source}")]
pub struct RoomError {
    doing: String,
    source: io::Error,
}

/// Targets of a list of paths: the real files and folders, and all symbolic links on the way to
/// them.
#[derive(Debug, Default, PartialEq)]
struct ResolvedPaths {
    /// Targets of the symbolic links, by the path of the link.
    links: BTreeMap<PathBuf, PathBuf>,
    /// Kinds of the real files and folders, by path.
    real: BTreeMap<PathBuf, FileKind>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum FileKind {
    Folder,
    File,
}

/// Moves this process into a new namespace room; the process cannot leave the room. The process
/// must have a single thread.
pub(super) fn enter(furniture: &RoomContents) -> Result<(), RoomError> {
    let RoomContents { shown, devices, sockets, home, network } = furniture;
    let seen = ResolvedPaths::of(shown.iter().chain(devices).chain(sockets));
    let devices = ResolvedPaths::real_ones(devices);
    let (uid, gid) = (rustix::process::getuid().as_raw(), rustix::process::getgid().as_raw());
    let mut namespaces =
        CloneFlags::CLONE_NEWUSER | CloneFlags::CLONE_NEWNS | CloneFlags::CLONE_NEWIPC;
    if !network {
        namespaces |= CloneFlags::CLONE_NEWNET;
    }
    unshare(namespaces).map_err(|errno| failed("make namespaces", errno.into()))?;
    write("/proc/self/setgroups", "deny")?;
    write("/proc/self/uid_map", &format!("{uid} {uid} 1"))?;
    write("/proc/self/gid_map", &format!("{gid} {gid} 1"))?;
    leave(home)?;
    seen.furnish()?;
    protect(&devices)?;
    bind(home, FileKind::Folder)?;
    let old = flags(&inside(home))? & !MountFlags::RDONLY;
    remount(&inside(home), old | MountFlags::NODEV | MountFlags::NOSUID)?;
    for (link, target) in OPEN_FILES {
        link_to(Path::new(link), Path::new(target))?;
    }
    if !inside(Path::new("/tmp")).exists() {
        link_to(Path::new("/tmp"), home)?;
    }
    remount(Path::new(NEW), MountFlags::RDONLY | MountFlags::NOSUID | MountFlags::NODEV)?;
    enter_new()
}

/// Moves the machine's files below [`OLD`], and mounts an empty root for the namespace room at
/// [`NEW`].
fn leave(somewhere: &Path) -> Result<(), RoomError> {
    let private = MountPropagationFlags::PRIVATE | MountPropagationFlags::REC;
    mount_change("/", private).map_err(|errno| failed("keep mounts private", errno.into()))?;
    // Any existing folder serves as a mount point; its contents are visible again once the new
    // mount is the root.
    tmpfs(somewhere)?;
    let base = |name: &str| somewhere.join(name.trim_start_matches('/'));
    for name in [OLD, NEW] {
        make_folder(&base(name))?;
    }
    pivot(somewhere, &base(OLD))?;
    tmpfs(Path::new(NEW))
}

/// Makes [`NEW`] the root of this process, and unmounts everything else.
fn enter_new() -> Result<(), RoomError> {
    std::env::set_current_dir(NEW).map_err(|error| failed("enter the namespace room", error))?;
    pivot(Path::new("."), Path::new("."))?;
    unmount(".", UnmountFlags::DETACH)
        .map_err(|errno| failed("unmount the old root", errno.into()))?;
    std::env::set_current_dir("/").map_err(|error| failed("enter the namespace room", error))
}

fn pivot(root: &Path, old: &Path) -> Result<(), RoomError> {
    let pivoted = rustix::process::pivot_root(root, old);
    pivoted.map_err(|errno| failed("change the root", errno.into()))?;
    match root == old {
        true => Ok(()),
        false => std::env::set_current_dir("/").map_err(|error| failed("change the root", error)),
    }
}

fn tmpfs(at: &Path) -> Result<(), RoomError> {
    let flags = MountFlags::NOSUID | MountFlags::NODEV;
    // A small size is enough, because the file system holds only names and links.
    let mounted = mount("althing", at, "tmpfs", flags, Some(c"mode=0755,size=4m"));
    mounted.map_err(|errno| failed(&format!("mount a tmpfs at {}", at.display()), errno.into()))
}

// === impl ResolvedPaths ===

impl ResolvedPaths {
    /// Follows paths on the machine. Paths that do not exist are left out.
    fn of<'p>(paths: impl Iterator<Item = &'p PathBuf>) -> ResolvedPaths {
        let mut places = ResolvedPaths::default();
        for path in paths {
            places.follow(path);
        }
        let folders = places.real.iter().filter(|(_, kind)| **kind == FileKind::Folder);
        let folders: Vec<PathBuf> = folders.map(|(folder, _)| folder.clone()).collect();
        // The contents of a visible folder are visible anyway.
        let is_within =
            |path: &Path| folders.iter().any(|folder| path != folder && path.starts_with(folder));
        places.real.retain(|path, _| !is_within(path));
        places.links.retain(|path, _| !is_within(path));
        places
    }

    /// Returns the real files and folders behind paths, with all symbolic links resolved.
    fn real_ones(paths: &[PathBuf]) -> Vec<PathBuf> {
        ResolvedPaths::of(paths.iter()).real.into_keys().collect()
    }

    fn follow(&mut self, path: &Path) {
        let mut rest: VecDeque<_> = path.components().map(owned).collect();
        let (mut at, mut links) = (PathBuf::from("/"), Vec::new());
        while let Some(part) = rest.pop_front() {
            match part.as_path() {
                part if part == Path::new("/") => at = PathBuf::from("/"),
                part if part == Path::new("..") => drop(at.pop()),
                part => {
                    let next = at.join(part);
                    let Ok(metadata) = fs::symlink_metadata(&next) else { return };
                    if !metadata.is_symlink() {
                        at = next;
                        continue;
                    }
                    let Ok(target) = fs::read_link(&next) else { return };
                    for part in target.components().rev().map(owned) {
                        rest.push_front(part);
                    }
                    links.push((next, target));
                    if links.len() > LINKS_MAX {
                        return;
                    }
                }
            }
        }
        let kind = if at.is_dir() { FileKind::Folder } else { FileKind::File };
        self.real.insert(at, kind);
        self.links.extend(links);
    }

    /// Creates all these files, folders and links in the new namespace room.
    fn furnish(&self) -> Result<(), RoomError> {
        for (path, kind) in &self.real {
            bind(path, *kind)?;
        }
        for (link, target) in &self.links {
            link_to(link, target)?;
        }
        Ok(())
    }
}

fn owned(part: Component<'_>) -> PathBuf {
    PathBuf::from(part.as_os_str())
}

/// Returns the path of a file of the machine while the machine's root is at [`OLD`].
fn outside(path: &Path) -> PathBuf {
    Path::new(OLD).join(path.strip_prefix("/").unwrap_or(path))
}

/// Returns the path of a file of the namespace room before the process enters the room.
fn inside(path: &Path) -> PathBuf {
    Path::new(NEW).join(path.strip_prefix("/").unwrap_or(path))
}

/// Mounts a file or folder at the same path in the namespace room, together with all mounts below
/// it.
fn bind(path: &Path, kind: FileKind) -> Result<(), RoomError> {
    let (from, to) = (outside(path), inside(path));
    match kind {
        FileKind::Folder => make_folder(&to)?,
        FileKind::File => {
            make_folder(to.parent().unwrap_or(Path::new("/")))?;
            if !to.exists() {
                fs::File::create(&to).map_err(|error| failed_at("make", &to, error))?;
            }
        }
    }
    let bound = mount_bind_recursive(&from, &to);
    bound.map_err(|errno| failed_at("show", path, errno.into()))
}

fn link_to(link: &Path, target: &Path) -> Result<(), RoomError> {
    let at = inside(link);
    make_folder(at.parent().unwrap_or(Path::new("/")))?;
    match std::os::unix::fs::symlink(target, &at) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
            Err(failed_at("link", link, error))
        }
        _ => Ok(()),
    }
}

fn make_folder(folder: &Path) -> Result<(), RoomError> {
    fs::create_dir_all(folder).map_err(|error| failed_at("make", folder, error))
}

/// Makes all mounts so far read-only, and forbids opening any device except those in `devices`.
fn protect(devices: &[PathBuf]) -> Result<(), RoomError> {
    let devices: Vec<_> = devices.iter().map(|device| inside(device)).collect();
    for mounted in mounts()?.iter().filter(|mounted| mounted.as_path() != Path::new(NEW)) {
        let mut flags = flags(mounted)? | MountFlags::RDONLY | MountFlags::NOSUID;
        if !devices.iter().any(|device| mounted.starts_with(device)) {
            flags |= MountFlags::NODEV;
        }
        remount(mounted, flags)?;
    }
    Ok(())
}

/// Returns the mount points in the namespace room.
fn mounts() -> Result<Vec<PathBuf>, RoomError> {
    let table = outside(Path::new("/proc/self/mountinfo"));
    let table = fs::read_to_string(&table).map_err(|error| failed_at("read", &table, error))?;
    let places = table.lines().filter_map(|line| line.split(' ').nth(4)).map(unescaped);
    Ok(places.filter(|place| place.starts_with(NEW)).collect())
}

/// Decodes a path from the kernel's table of mounts, in which blanks are written as `\040`.
fn unescaped(text: &str) -> PathBuf {
    use std::os::unix::ffi::OsStringExt as _;
    let (mut bytes, mut rest) = (Vec::new(), text.as_bytes());
    while let Some((first, after)) = rest.split_first() {
        let octal = (*first == b'\\').then(|| after.get(..3)).flatten();
        let octal = octal.and_then(|digits| std::str::from_utf8(digits).ok());
        match octal.and_then(|digits| u8::from_str_radix(digits, 8).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &after[3..];
            }
            None => {
                bytes.push(*first);
                rest = after;
            }
        }
    }
    PathBuf::from(std::ffi::OsString::from_vec(bytes))
}

/// Returns the flags of a mount. A remount has to keep the flags that another process has set,
/// because the kernel does not let this process clear them.
fn flags(mounted: &Path) -> Result<MountFlags, RoomError> {
    let known = rustix::fs::statvfs(mounted);
    let known = known.map_err(|errno| failed_at("look at", mounted, errno.into()))?.f_flag;
    let mut flags = MountFlags::empty();
    for (is, means) in [
        (StatVfsMountFlags::RDONLY, MountFlags::RDONLY),
        (StatVfsMountFlags::NOSUID, MountFlags::NOSUID),
        (StatVfsMountFlags::NODEV, MountFlags::NODEV),
        (StatVfsMountFlags::NOEXEC, MountFlags::NOEXEC),
        (StatVfsMountFlags::NOATIME, MountFlags::NOATIME),
        (StatVfsMountFlags::NODIRATIME, MountFlags::NODIRATIME),
        (StatVfsMountFlags::RELATIME, MountFlags::RELATIME),
    ] {
        flags.set(means, known.contains(is));
    }
    Ok(flags)
}

fn remount(mounted: &Path, flags: MountFlags) -> Result<(), RoomError> {
    let remounted = mount_remount(mounted, flags | MountFlags::BIND, c"");
    remounted.map_err(|errno| failed_at("protect", mounted, errno.into()))
}

fn write(file: &str, text: &str) -> Result<(), RoomError> {
    fs::write(file, text).map_err(|error| failed_at("write", Path::new(file), error))
}

fn failed(doing: &str, source: io::Error) -> RoomError {
    RoomError { doing: doing.to_owned(), source }
}

fn failed_at(doing: &str, path: &Path, source: io::Error) -> RoomError {
    RoomError { doing: format!("{doing} {}", path.display()), source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_kept_and_files_below_a_visible_folder_are_merged() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path().canonicalize().expect("it is there");
        let at = |name: &str| root.join(name);
        fs::create_dir_all(at("versions/3.1/bin")).expect("made");
        fs::write(at("versions/3.1/bin/python"), "").expect("written");
        let link = |target: &str, name: &str| std::os::unix::fs::symlink(target, at(name));
        link("versions", "v").expect("a link");
        link("3.1", "versions/current").expect("a link");
        link("round", "round").expect("a link");
        let paths = ["v/current/bin/python", "v/3.1", "no/such", "round", "v/../v"].map(at);
        let places = ResolvedPaths::of(paths[..1].iter());
        assert_eq!(places.real.get(&at("versions/3.1/bin/python")), Some(&FileKind::File));
        let links: Vec<_> = places.links.keys().cloned().collect();
        assert_eq!(links, [at("v"), at("versions/current")]);
        let places = ResolvedPaths::of(paths[..4].iter());
        assert_eq!(places.real, BTreeMap::from([(at("versions/3.1"), FileKind::Folder)]));
        // If their common folder is visible, the links in it are, too.
        let places = ResolvedPaths::of(paths.iter());
        assert_eq!(places.real, BTreeMap::from([(at("versions"), FileKind::Folder)]));
        assert_eq!(places.links, BTreeMap::from([(at("v"), PathBuf::from("versions"))]));
    }

    #[test]
    fn octal_escapes_in_mount_paths_are_decoded() {
        assert_eq!(unescaped("/a\\040b\\134"), Path::new("/a b\\"));
        assert_eq!(unescaped("/a\\04"), Path::new("/a\\04"));
    }
}

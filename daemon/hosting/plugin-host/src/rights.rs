//! Rights of plugins: the rights that a manifest requests, those that a person has allowed, and
//! those that cannot be allowed. This module accesses no files and no clock.
//!
//! Every plugin has the minimum, [`Permissions::default`]. Each permission beyond the minimum that
//! a manifest requests is a [`Right`], which takes effect once a person has allowed it.

use std::fmt;
use std::path::{Component, Path, PathBuf};
use std::str::FromStr;

/// Resources of the machine that a plugin may use.
#[derive(Clone, Debug, PartialEq)]
pub struct Permissions {
    /// Whether the plugin may open connections other than the one to its daemon.
    pub network: bool,
    /// Devices that the plugin may read and write, such as `/dev/i2c-1`.
    pub devices: Vec<PathBuf>,
    /// Files and folders that the plugin may read, in addition to those of the system and of its
    /// package.
    pub read: Vec<PathBuf>,
    /// Limit of the memory of all processes of the plugin, in bytes.
    pub memory: u64,
    /// Share of one processor core that the plugin may use, at least 0.01; 1.0 is a whole core.
    pub cpu: f64,
    /// Limit of the number of open files.
    pub files: u64,
    /// Limit of the number of processes.
    pub processes: u32,
    /// Limit of the bytes that the plugin may keep on disk.
    pub disk: u64,
}

/// One permission beyond the minimum that every plugin has.
#[derive(Clone, Debug, PartialEq)]
pub enum Right {
    /// Permission to open connections other than the one to the plugin's daemon.
    Network,
    /// Permission to read and write this device.
    Device(PathBuf),
    /// Permission to read this file or folder.
    Read(PathBuf),
    /// Permission to use this many bytes of memory.
    Memory(u64),
    /// Permission to use this share of one processor core.
    Cpu(f64),
    /// Permission to have this many files open.
    Files(u64),
    /// Permission to have this many processes.
    Processes(u32),
    /// Permission to keep this many bytes on disk.
    Disk(u64),
}

/// Prefixes or full names of the devices below `/dev` that no plugin may use, because they give
/// access to the whole machine or to its screen and keyboard: memory, disks, file systems,
/// terminals, simulated keyboards, virtual machines. A `*` at the end marks a prefix.
const NO_DEVICES: &[&str] = &[
    "mem",
    "kmem",
    "port",
    "vc-mem",
    "vcio",
    "kmsg",
    "console",
    "tty",
    "tty0",
    "tty1*",
    "tty2*",
    "tty3*",
    "tty4*",
    "tty5*",
    "tty6*",
    "tty7*",
    "tty8*",
    "tty9*",
    "ptmx",
    "pts",
    "vcs*",
    "shm",
    "mqueue",
    "hugepages",
    "fd",
    "stdin",
    "stdout",
    "stderr",
    "fuse",
    "cuse",
    "kvm",
    "net",
    "vhost*",
    "loop*",
    "dm-*",
    "mapper",
    "md*",
    "sd*",
    "hd*",
    "vd*",
    "xvd*",
    "nvme*",
    "mmcblk*",
    "zram*",
    "dax*",
    "ubi*",
    "ng*",
    "ram*",
    "sr*",
    "sg*",
    "nbd*",
    "bsg",
    "block",
    "disk",
    "char",
    "mtd*",
    "uinput",
    "uhid",
    "userio",
    "usbmon*",
    "vhci*",
    "autofs",
    "btrfs-control",
    "snapshot",
    "cpu",
    "vfio",
    "udmabuf",
    "dma_heap",
    "userfaultfd",
    "initctl",
    "log",
];

/// Folders that a person cannot allow a plugin to read as a whole, because many users or programs
/// share them. Single files and folders in them can be allowed.
const NO_FOLDERS: &[&str] =
    &["/", "/etc", "/home", "/root", "/run", "/srv", "/tmp", "/var", "/var/lib"];

/// Files and folders that no plugin may read, including their contents: they hold keys, passwords,
/// or data of other processes.
const SECRET: &[&str] = &[
    "/boot",
    "/dev",
    "/proc",
    "/etc/althing",
    "/etc/gshadow",
    "/etc/passwd-",
    "/etc/security",
    "/etc/shadow",
    "/etc/ssh",
    "/etc/ssl/private",
    "/etc/sudoers",
    "/etc/sudoers.d",
    "/run/althing",
    "/run/private",
    "/run/credentials",
    "/run/secrets",
    "/run/user",
    "/var/lib/althing",
    "/var/lib/private",
    "/var/log",
];

/// Names of files and folders that no plugin may read in any place, because they hold keys. Most of
/// them are in home folders.
const SECRET_NAMES: &[&str] =
    &[".aws", ".config", ".gnupg", ".kube", ".netrc", ".password-store", ".ssh"];

impl Default for Permissions {
    /// Returns the minimum of permissions, which every plugin has.
    fn default() -> Permissions {
        Permissions {
            network: false,
            devices: Vec::new(),
            read: Vec::new(),
            // Enough for an agent in another language: an interpreter and a Zenoh session.
            memory: 128 << 20,
            // Interpreters load for about a second; a sensor does not compute for longer.
            cpu: 0.5,
            // Enough for sockets, pipes and a few devices.
            files: 64,
            // Enough for a program and the programs that it calls.
            processes: 16,
            // Enough for settings, and measurements of a day.
            disk: 256 << 20,
        }
    }
}

impl Permissions {
    /// Returns the rights that these permissions need beyond the minimum.
    pub fn asks(&self) -> Vec<Right> {
        let least = Permissions::default();
        let mut asks = Vec::new();
        asks.extend(self.network.then_some(Right::Network));
        asks.extend(self.devices.iter().cloned().map(Right::Device));
        asks.extend(self.read.iter().cloned().map(Right::Read));
        asks.extend((self.memory > least.memory).then_some(Right::Memory(self.memory)));
        asks.extend((self.cpu > least.cpu).then_some(Right::Cpu(self.cpu)));
        asks.extend((self.files > least.files).then_some(Right::Files(self.files)));
        asks.extend((self.processes > least.processes).then_some(Right::Processes(self.processes)));
        asks.extend((self.disk > least.disk).then_some(Right::Disk(self.disk)));
        asks
    }

    /// Returns the rights that these permissions need and that are not in `allowed`.
    pub fn beyond(&self, allowed: &[Right]) -> Vec<Right> {
        let is_allowed = |asked: &Right| allowed.iter().any(|allowed| allowed.covers(asked));
        self.asks().into_iter().filter(|asked| !is_allowed(asked)).collect()
    }
}

impl Right {
    /// Whether this right includes the right `other`.
    pub fn covers(&self, other: &Right) -> bool {
        match (self, other) {
            (Right::Memory(may), Right::Memory(asks)) | (Right::Disk(may), Right::Disk(asks)) => {
                may >= asks
            }
            (Right::Files(may), Right::Files(asks)) => may >= asks,
            (Right::Cpu(may), Right::Cpu(asks)) => may >= asks,
            (Right::Processes(may), Right::Processes(asks)) => may >= asks,
            (one, other) => one == other,
        }
    }

    /// Describes the right for the person that decides whether to allow it.
    pub fn meaning(&self) -> String {
        match self {
            Right::Network => "to connect to the Internet and to this network".to_owned(),
            Right::Device(path) => format!("to read and write the device {}", path.display()),
            Right::Read(path) => format!("to read {}", path.display()),
            Right::Memory(bytes) => format!("to hold {} of memory", bytes_text(*bytes)),
            Right::Cpu(share) => format!("to use {:.0} % of a core", share * 100.0),
            Right::Files(files) => format!("to have {files} files open"),
            Right::Processes(processes) => format!("to run {processes} processes at a time"),
            Right::Disk(bytes) => format!("to keep {} on disk", bytes_text(*bytes)),
        }
    }
}

/// Formats the right as an argument of `--allow`: the key in the manifest, and the value of the
/// key.
impl fmt::Display for Right {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Right::Network => f.write_str("network"),
            Right::Device(path) => write!(f, "devices={}", path.display()),
            Right::Read(path) => write!(f, "read={}", path.display()),
            Right::Memory(bytes) => write!(f, "memory={}", bytes_text(*bytes)),
            Right::Cpu(share) => write!(f, "cpu={share}"),
            Right::Files(files) => write!(f, "files={files}"),
            Right::Processes(processes) => write!(f, "processes={processes}"),
            Right::Disk(bytes) => write!(f, "disk={}", bytes_text(*bytes)),
        }
    }
}

impl FromStr for Right {
    type Err = String;

    fn from_str(text: &str) -> Result<Right, String> {
        let known = "network, devices=PATH, read=PATH, memory=SIZE, cpu=SHARE, files=N, processes=N, disk=SIZE";
        let (key, value) = text.split_once('=').unwrap_or((text, ""));
        let bytes =
            || bytes_of(value).ok_or_else(|| format!("`{text}`: write a size such as 256MiB"));
        let number = || value.parse().map_err(|_| format!("`{text}`: write a number"));
        match (key.trim(), value) {
            ("network", "") => Ok(Right::Network),
            ("devices", path) if !path.is_empty() => Ok(Right::Device(PathBuf::from(path))),
            ("read", path) if !path.is_empty() => Ok(Right::Read(PathBuf::from(path))),
            ("memory", _) => Ok(Right::Memory(bytes()?)),
            ("disk", _) => Ok(Right::Disk(bytes()?)),
            ("cpu", _) => {
                Ok(Right::Cpu(value.parse().map_err(|_| format!("`{text}`: write a share"))?))
            }
            ("files", _) => Ok(Right::Files(number()?)),
            ("processes", _) => {
                let number: u64 = number()?;
                Ok(Right::Processes(u32::try_from(number).unwrap_or(u32::MAX)))
            }
            _ => Err(format!("`{text}` is no right; there are {known}")),
        }
    }
}

/// Formats rights as a list for a person, separated by spaces.
pub fn listed(rights: &[Right]) -> String {
    rights.iter().map(Right::to_string).collect::<Vec<_>>().join(" ")
}

/// Returns the reason why the device at `path` cannot be allowed to any plugin, considering only
/// the path; `None` if the device can be allowed.
pub(crate) fn device_objection(path: &Path) -> Option<String> {
    if let Some(objection) = path_objection(path) {
        return Some(objection);
    }
    let Ok(below) = path.strip_prefix("/dev") else {
        return Some("it is not below /dev".to_owned());
    };
    let Some(first) = below.components().next() else {
        return Some("these are all devices: name those that it needs".to_owned());
    };
    let first = first.as_os_str().to_string_lossy();
    let is_it = |known: &&&str| match known.strip_suffix('*') {
        Some(beginning) => first.starts_with(beginning),
        None => first == ***known,
    };
    NO_DEVICES
        .iter()
        .find(is_it)
        .map(|_| "it gives access to the whole machine, or to its screen and keyboard".to_owned())
}

/// Returns the reason why the file or folder at `path` cannot be allowed to any plugin, considering
/// only the path; `None` if it can be allowed.
pub(crate) fn read_objection(path: &Path) -> Option<String> {
    if let Some(objection) = path_objection(path) {
        return Some(objection);
    }
    let is_whole = NO_FOLDERS.iter().any(|folder| path == Path::new(folder));
    let is_home = path.parent() == Some(Path::new("/home"));
    if is_whole || is_home {
        return Some(
            "many programs and users share this folder: name the file or folder in it that the \
             plugin needs"
                .to_owned(),
        );
    }
    let holds_keys = |part: Component<'_>| {
        SECRET_NAMES.iter().any(|name| part.as_os_str() == std::ffi::OsStr::new(name))
    };
    let is_secret = SECRET.iter().any(|secret| path.starts_with(secret));
    (is_secret || path.components().any(holds_keys))
        .then(|| "secrets of this machine are there".to_owned())
}

fn path_objection(path: &Path) -> Option<String> {
    if !path.is_absolute() {
        return Some("write an absolute path".to_owned());
    }
    let is_printed = path.to_str().is_some_and(|text| !text.contains(char::is_control));
    if !is_printed {
        return Some("it has control characters, or is not UTF-8".to_owned());
    }
    let is_plain = |part| matches!(part, Component::Normal(_) | Component::RootDir);
    (!path.components().all(is_plain))
        .then(|| "it contains `..`: write the path without it".to_owned())
}

/// Parses a size such as `"64MiB"` into bytes; returns `None` if the text is not a whole number
/// with a unit, or the size is too large.
pub(crate) fn bytes_of(text: &str) -> Option<u64> {
    let units = [("GiB", 30), ("MiB", 20), ("KiB", 10)];
    let (number, shift) =
        units.iter().find_map(|(unit, shift)| Some((text.strip_suffix(unit)?, *shift)))?;
    let number: u64 = number.trim().parse().ok()?;
    number.checked_mul(1 << shift)
}

/// Formats a number of bytes as in a manifest, in the largest unit of GiB, MiB and KiB that is
/// exact. A number that is not a multiple of 1 KiB is rounded up to KiB.
pub(crate) fn bytes_text(bytes: u64) -> String {
    let units = [("GiB", 30), ("MiB", 20)];
    let whole = units.into_iter().find(|(_, shift)| bytes > 0 && bytes.is_multiple_of(1 << shift));
    match whole {
        Some((unit, shift)) => format!("{}{unit}", bytes >> shift),
        None => format!("{}KiB", bytes.div_ceil(1 << 10)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rights_are_formatted_as_they_are_parsed() {
        for text in [
            "network",
            "devices=/dev/i2c-1",
            "read=/sys",
            "memory=512MiB",
            "cpu=1.5",
            "files=256",
            "processes=32",
            "disk=2GiB",
        ] {
            let right: Right = text.parse().expect(text);
            assert_eq!(right.to_string(), text);
        }
        for (text, expected) in [
            ("devices", "is no right"),
            ("network=yes", "is no right"),
            ("memory=64", "write a size"),
            ("files=many", "write a number"),
            ("everything", "there are network, devices=PATH"),
        ] {
            let problem = text.parse::<Right>().expect_err(text);
            assert!(problem.contains(expected), "{problem}");
        }
    }

    #[test]
    fn permissions_beyond_the_minimum_are_rights() {
        let least = Permissions::default();
        assert_eq!(least.asks(), []);
        let asked = Permissions {
            network: true,
            devices: vec!["/dev/i2c-1".into()],
            memory: least.memory / 2,
            cpu: 2.0,
            ..least
        };
        assert_eq!(listed(&asked.asks()), "network devices=/dev/i2c-1 cpu=2");
        let allowed = [Right::Network, Right::Cpu(4.0), Right::Device("/dev/i2c-2".into())];
        assert_eq!(listed(&asked.beyond(&allowed)), "devices=/dev/i2c-1");
    }

    #[test]
    fn shared_and_secret_paths_cannot_be_allowed() {
        for path in [
            "/",
            "/dev",
            "/dev/mem",
            "/dev/sda1",
            "/dev/nvme0n1",
            "/dev/tty1",
            "/dev/pts/0",
            "/dev/net/tun",
            "/dev/uinput",
            "/dev/cuse",
            "/dev/userio",
            "/dev/vhci",
            "/dev/usbmon0",
            "/dev/ng0n1",
            "/dev/ubi0_0",
            "/dev/dax0.0",
            "/dev/vc-mem",
            "/dev/vcio",
            "/dev/../etc",
            "/dev/i2c-1\x1b[2K",
            "/etc/shadow",
            "i2c-1",
            "/sys/class/gpio",
            "/home/anna",
        ] {
            assert!(device_objection(Path::new(path)).is_some(), "{path}");
        }
        for path in [
            "/dev/i2c-1",
            "/dev/ttyUSB0",
            "/dev/ttyACM0",
            "/dev/serial/by-id/x",
            "/dev/gpiochip0",
            "/dev/video0",
            "/dev/input/event3",
            "/dev/bus/usb",
            "/dev/snd",
        ] {
            assert_eq!(device_objection(Path::new(path)), None, "{path}");
        }
        for path in [
            "/",
            "/home",
            "/home/anna",
            "/root",
            "/etc",
            "/etc/shadow",
            "/etc/althing/keys",
            "/proc/1/environ",
            "/dev/i2c-1",
            "/home/anna/.ssh/id",
            "/home/anna/.config/althing/keys",
            "/var",
            "/run/user/1000",
            "/run/private/althing/plugins",
            "/var/lib/private/weather",
            "data",
            "/opt/../etc/shadow",
        ] {
            assert!(read_objection(Path::new(path)).is_some(), "{path}");
        }
        for path in [
            "/sys",
            "/opt/maps",
            "/home/anna/building",
            "/etc/thermometers.conf",
            "/run/udev",
            "/srv/maps",
            "/var/lib/weather",
        ] {
            assert_eq!(read_objection(Path::new(path)), None, "{path}");
        }
    }

    #[test]
    fn sizes_are_formatted_as_they_are_parsed() {
        for (bytes, text) in [(1 << 30, "1GiB"), (96 << 20, "96MiB"), (1_536, "2KiB"), (0, "0KiB")]
        {
            assert_eq!(bytes_text(bytes), text);
        }
        assert_eq!(bytes_of("96MiB"), Some(96 << 20));
    }
}

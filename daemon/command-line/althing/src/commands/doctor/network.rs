//! Checks of the machine's network: whether daemons can scout by multicast, and whether the ports
//! of the ecosystem file are free.

use std::fs;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, UdpSocket};
use std::path::Path;

use serde_json::Value;

use super::finding::{CheckFinding, DoctorCheck, Remedy, names};
use crate::commands::daemon_sockets;
use crate::config::Ecosystem;
use crate::hosting;

/// Folder in which the kernel lists the network interfaces.
const INTERFACES: &str = "/sys/class/net";

/// Flags of an interface, as the kernel shows them in its file `flags`.
const UP: u64 = 0x1;
const LOOPBACK: u64 = 0x8;
const MULTICAST: u64 = 0x1000;

/// The multicast group at which daemons scout.
const GROUP: Ipv4Addr = Ipv4Addr::new(224, 0, 0, 224);

/// State of TCP sockets that listen, in `/proc/net/tcp`.
const LISTENS: &str = "0A";

/// A network interface of this machine, apart from loopback interfaces.
struct NetworkInterface {
    name: String,
    is_up: bool,
    has_multicast: bool,
}

/// Checks whether this machine can receive multicast, if the ecosystem scouts.
pub(super) fn multicast(ecosystem: Option<&Ecosystem>) -> Vec<CheckFinding> {
    let interfaces = interfaces(Path::new(INTERFACES));
    let joined = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))
        .and_then(|socket| socket.join_multicast_v4(&GROUP, &Ipv4Addr::UNSPECIFIED));
    vec![multicast_finding(&interfaces, joined, ecosystem.is_some_and(scouts))]
}

fn multicast_finding(
    interfaces: &[NetworkInterface],
    joined: io::Result<()>,
    scouts: bool,
) -> CheckFinding {
    let check = DoctorCheck::Multicast;
    let able: Vec<_> = interfaces.iter().filter(|one| one.is_up && one.has_multicast).collect();
    let first_that = |is_it: &dyn Fn(&NetworkInterface) -> bool| {
        interfaces.iter().find(|one| is_it(one)).map(|one| one.name.as_str())
    };
    let (text, mend) = match (able.first(), joined) {
        (Some(_), Ok(())) => {
            let able = names(able.iter().map(|one| &one.name));
            return check.ok(format!("{able} can receive multicast"));
        }
        (Some(able), Err(error)) => (
            format!("no route for multicast ({error})"),
            Some(format!("sudo ip route add 224.0.0.0/4 dev {}", able.name)),
        ),
        (None, _) => {
            let without = first_that(&|one| one.is_up && !one.has_multicast);
            let down = first_that(&|one| !one.is_up);
            let mend = match (without, down) {
                (Some(name), _) => Some(format!("sudo ip link set dev {name} multicast on")),
                (None, Some(name)) => Some(format!("sudo ip link set dev {name} up")),
                (None, None) => None,
            };
            ("no network interface can receive multicast".to_owned(), mend)
        }
    };
    if !scouts {
        return check.note(format!("{text}; this ecosystem does not scout"), None);
    }
    let text = format!("{text}: daemons of other machines are not found");
    check.problem(text, mend.map(Remedy::Mend))
}

fn interfaces(folder: &Path) -> Vec<NetworkInterface> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut interfaces: Vec<_> = entries
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let text = fs::read_to_string(entry.path().join("flags")).ok()?;
            let flags = u64::from_str_radix(text.trim().trim_start_matches("0x"), 16).ok()?;
            (flags & LOOPBACK == 0).then_some(NetworkInterface {
                name,
                is_up: flags & UP != 0,
                has_multicast: flags & MULTICAST != 0,
            })
        })
        .collect();
    interfaces.sort_by(|one, other| one.name.cmp(&other.name));
    interfaces
}

/// Whether the daemons of an ecosystem scout, as docs/reliability.md says it: by the file, otherwise
/// if the ecosystem is secured and its daemons listen beyond their machines.
fn scouts(ecosystem: &Ecosystem) -> bool {
    let said = ecosystem.zenoh["scouting"].as_bool();
    let beyond = || {
        let mut addresses = listened(ecosystem).into_iter();
        addresses.any(|address| !address.ip().is_loopback())
    };
    said.unwrap_or_else(|| ecosystem.security.is_some() && beyond())
}

/// Returns the addresses at which the file lets daemons listen. Names of hosts are left out.
fn listened(ecosystem: &Ecosystem) -> Vec<SocketAddr> {
    let mut texts = Vec::new();
    collect_texts(&ecosystem.zenoh["listen"]["endpoints"], &mut texts);
    let address = |text: &&str| {
        let (_, rest) = text.split_once('/')?;
        rest.split(['#', '?']).next()?.parse().ok()
    };
    let page = ecosystem.web.as_ref().map(|web| web.listen);
    texts.iter().filter_map(address).chain(ecosystem.metrics).chain(page).collect()
}

/// Collects the texts in a setting, which Zenoh allows in several shapes.
fn collect_texts<'v>(value: &'v Value, texts: &mut Vec<&'v str>) {
    match value {
        Value::String(text) => texts.push(text),
        Value::Array(items) => items.iter().for_each(|item| collect_texts(item, texts)),
        Value::Object(table) => table.values().for_each(|item| collect_texts(item, texts)),
        Value::Null | Value::Bool(_) | Value::Number(_) => (),
    }
}

/// Checks whether the ports at which the file lets daemons listen are free.
pub(super) fn ports(ecosystem: Option<&Ecosystem>) -> Vec<CheckFinding> {
    let check = DoctorCheck::Ports;
    let Some(ecosystem) = ecosystem else {
        return vec![check.ok("no ecosystem file, so no port is needed")];
    };
    let addresses: Vec<_> =
        listened(ecosystem).into_iter().filter(|address| address.port() != 0).collect();
    if addresses.is_empty() {
        return vec![check.ok("the file names no port")];
    }
    let folder = hosting::runtime_base().join(ecosystem.name.as_str());
    let sockets = hosting::daemon_sockets(&folder);
    if sockets.iter().any(|socket| daemon_sockets::is_listening(socket)) {
        return vec![check.ok("a daemon of the ecosystem runs here and has its ports")];
    }
    addresses.into_iter().map(port).collect()
}

fn port(address: SocketAddr) -> CheckFinding {
    let (check, number) = (DoctorCheck::Ports, address.port());
    match TcpListener::bind(address) {
        Ok(_) => check.ok(format!("{address} is free")),
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => match holder(number) {
            Some((process, name)) => check.problem(
                format!("{address} is taken by process {process} ({name})"),
                Remedy::look(format!("ps -fp {process}")),
            ),
            None => check.problem(
                format!("{address} is taken by another program"),
                Remedy::look(format!("sudo ss -ltnp 'sport = :{number}'")),
            ),
        },
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => check.problem(
            format!("this user may not listen at {address}"),
            Remedy::mend(format!("sudo sysctl net.ipv4.ip_unprivileged_port_start={number}")),
        ),
        Err(error) => {
            let text = format!("{address} cannot be listened at: {error}");
            check.problem(text, Remedy::look("ip address"))
        }
    }
}

/// Returns the process that listens at a TCP port, and its name; `None` if this user may not see it.
fn holder(port: u16) -> Option<(u32, String)> {
    let tables = ["/proc/net/tcp", "/proc/net/tcp6"];
    let text: String = tables.iter().filter_map(|path| fs::read_to_string(path).ok()).collect();
    let sockets: Vec<String> = text.lines().filter_map(|line| socket_at(line, port)).collect();
    let processes = fs::read_dir("/proc").ok()?.flatten();
    processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok()).find_map(
        |process| {
            let open = fs::read_dir(format!("/proc/{process}/fd")).ok()?.flatten();
            let mut targets = open.filter_map(|entry| fs::read_link(entry.path()).ok());
            let is_it = |target: std::path::PathBuf| {
                sockets.iter().any(|socket| target.as_os_str() == socket.as_str())
            };
            targets.any(is_it).then(|| {
                let name = fs::read_to_string(format!("/proc/{process}/comm"));
                (process, name.unwrap_or_default().trim().to_owned())
            })
        },
    )
}

/// Reads a line of `/proc/net/tcp`; returns the link target of the socket's file descriptors if the
/// socket listens at this port.
fn socket_at(line: &str, port: u16) -> Option<String> {
    let mut words = line.split_whitespace().skip(1);
    let (_, local) = words.next()?.rsplit_once(':')?;
    let is_it = u16::from_str_radix(local, 16) == Ok(port) && words.nth(1)? == LISTENS;
    let inode = words.nth(5)?;
    is_it.then(|| format!("socket:[{inode}]"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::doctor::finding::CheckVerdict;

    fn interface(name: &str, is_up: bool, has_multicast: bool) -> NetworkInterface {
        NetworkInterface { name: name.to_owned(), is_up, has_multicast }
    }

    fn refused() -> io::Result<()> {
        Err(io::Error::from(io::ErrorKind::NetworkUnreachable))
    }

    #[test]
    fn interfaces_are_read_without_loopback() {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, flags) in [("lo", "0x9\n"), ("eth0", "0x1003\n"), ("wlan0", "0x1002\n")] {
            fs::create_dir(folder.path().join(name)).expect("a folder");
            fs::write(folder.path().join(name).join("flags"), flags).expect("a file");
        }
        let found = interfaces(folder.path());
        let told: Vec<_> =
            found.iter().map(|one| (one.name.as_str(), one.is_up, one.has_multicast)).collect();
        assert_eq!(told, [("eth0", true, true), ("wlan0", false, true)]);
    }

    #[test]
    fn multicast_is_needed_only_by_an_ecosystem_that_scouts() {
        let (able, down) = ([interface("eth0", true, true)], [interface("eth0", false, true)]);
        assert_eq!(multicast_finding(&able, Ok(()), true).verdict, CheckVerdict::Ok);
        let unrouted = multicast_finding(&able, refused(), true);
        assert_eq!(unrouted.remedy, Remedy::mend("sudo ip route add 224.0.0.0/4 dev eth0"));
        let off = multicast_finding(&down, refused(), true);
        assert_eq!(off.remedy, Remedy::mend("sudo ip link set dev eth0 up"));
        let deaf = multicast_finding(&[interface("eth0", true, false)], refused(), true);
        assert_eq!(deaf.remedy, Remedy::mend("sudo ip link set dev eth0 multicast on"));
        assert_eq!(multicast_finding(&[], refused(), true).verdict, CheckVerdict::Problem);
        assert_eq!(multicast_finding(&[], refused(), false).verdict, CheckVerdict::Note);
    }

    #[test]
    fn the_process_at_a_port_is_found() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let taken = port(address);
        assert_eq!(taken.verdict, CheckVerdict::Problem);
        let look = format!("ps -fp {}", std::process::id());
        assert_eq!(taken.remedy, Some(Remedy::Look(look)), "{}", taken.text);
        drop(listener);
        assert_eq!(port(address).verdict, CheckVerdict::Ok);
    }
}

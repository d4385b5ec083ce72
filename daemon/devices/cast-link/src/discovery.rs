//! Finds the Chromecasts of a network by multicast DNS (`_googlecast._tcp`): a question to all
//! devices, which every Chromecast answers.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV4};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use tokio::net::UdpSocket;
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::CastAddress;
use crate::dns::{self, DnsService};
use crate::error::excerpt;

/// Group and port of multicast DNS.
pub const MULTICAST_DNS: SocketAddr =
    SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::new(224, 0, 0, 251), 5353));

/// Name of the service, as Chromecasts announce it.
const SERVICE: &str = "_googlecast._tcp.local";

/// Maximum number of devices; further ones are ignored.
const DEVICES_MAX: usize = 256;

/// Maximum length of an answer, in bytes, as multicast DNS has it. A longer answer is cut off.
const ANSWER_BYTES_MAX: usize = 9_000;

/// Times after the beginning at which the question is asked: datagrams get lost, and a device on
/// Wi-Fi may sleep for a second.
const ASK_AT: [Duration; 3] = [Duration::ZERO, Duration::from_secs(1), Duration::from_secs(3)];

/// Maximum number of network interfaces on which the question is asked.
const INTERFACES_MAX: usize = 16;

/// A device that has answered.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FoundCast {
    /// Identifier of the device, which stays the same.
    pub id: String,
    /// Name of the device for people; empty if the device reports none.
    pub name: String,
    /// Model of the device; empty if the device reports none.
    pub model: String,
    /// Address of the device, for the `address` of a config.
    pub address: String,
}

type Found = Mutex<BTreeMap<String, FoundCast>>;

/// Asks for Chromecasts during the time `lasts`: all in the network if `to` is a group such as
/// [`MULTICAST_DNS`], or else the device at `to`. Returns those that answer, in the order of their
/// identifiers.
///
/// # Errors
///
/// Returns an error if no question can be sent. Its text completes “failed to …”.
pub async fn discover(to: SocketAddr, lasts: Duration) -> Result<Vec<FoundCast>, String> {
    let failed = |problem: String| format!("look for Chromecasts: {problem}");
    let sockets = sockets(to).await.map_err(failed)?;
    let (found, began) = (std::sync::Arc::new(Found::default()), Instant::now());
    let mut asking = JoinSet::new();
    for socket in sockets {
        let found = std::sync::Arc::clone(&found);
        asking.spawn(async move { ask(&socket, to, began, lasts, &found).await });
    }
    let mut problem = None;
    for asked in asking.join_all().await {
        problem = problem.or(asked.err());
    }
    let found = std::mem::take(&mut *found.lock().unwrap_or_else(PoisonError::into_inner));
    match problem {
        Some(problem) if found.is_empty() => Err(failed(problem)),
        _ => Ok(found.into_values().collect()),
    }
}

/// Opens a socket for a device, or one per network interface for a group of devices: a question to
/// a group leaves on the interface of the address from which it is sent.
async fn sockets(to: SocketAddr) -> Result<Vec<UdpSocket>, String> {
    let from = match to.ip() {
        IpAddr::V4(ip) if ip.is_multicast() => own_addresses(),
        IpAddr::V4(_) => vec![IpAddr::V4(Ipv4Addr::UNSPECIFIED)],
        IpAddr::V6(_) => vec![IpAddr::V6(Ipv6Addr::UNSPECIFIED)],
    };
    let (mut sockets, mut problem) = (Vec::new(), "there is no network".to_owned());
    for from in from {
        match UdpSocket::bind(SocketAddr::new(from, 0)).await {
            Ok(socket) => sockets.push(socket),
            Err(error) => problem = error.to_string(),
        }
    }
    if sockets.is_empty() { Err(problem) } else { Ok(sockets) }
}

fn own_addresses() -> Vec<IpAddr> {
    let needed = InterfaceFlags::IFF_UP | InterfaceFlags::IFF_MULTICAST;
    let addresses = getifaddrs().into_iter().flatten().filter_map(|interface| {
        let is_useful = interface.flags.contains(needed);
        let address = interface.address.filter(|_| is_useful)?;
        Some(IpAddr::V4(address.as_sockaddr_in()?.ip()))
    });
    addresses.take(INTERFACES_MAX).collect()
}

async fn ask(
    socket: &UdpSocket,
    to: SocketAddr,
    began: Instant,
    lasts: Duration,
    found: &Found,
) -> Result<(), String> {
    let (question, mut buffer) = (dns::question(SERVICE), vec![0; ANSWER_BYTES_MAX]);
    let ends = began + lasts;
    let mut times = ASK_AT.into_iter().map(|at| began + at).filter(|at| *at < ends).peekable();
    while Instant::now() < ends {
        if times.next_if(|at| *at <= Instant::now()).is_some() {
            let sent = socket.send_to(&question, to).await;
            sent.map_err(|error| error.to_string())?;
        }
        let until = times.peek().copied().unwrap_or(ends);
        match tokio::time::timeout_at(until, socket.recv_from(&mut buffer)).await {
            Ok(Ok((length, from))) => {
                let answer = buffer.get(..length).unwrap_or_default();
                let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
                for service in dns::services(answer, SERVICE) {
                    let cast = read(&service, from.ip());
                    if found.len() < DEVICES_MAX {
                        found.insert(cast.id.clone(), cast);
                    }
                }
            }
            // The device of an earlier question is away.
            Ok(Err(error)) if error.kind() == std::io::ErrorKind::ConnectionRefused => (),
            Ok(Err(error)) => return Err(error.to_string()),
            // It is time for the next question, or for the end.
            Err(_) => (),
        }
    }
    Ok(())
}

/// Returns the device of an answer from `from`. An answer without an address is about its sender.
fn read(service: &DnsService, from: IpAddr) -> FoundCast {
    let property = |key: &str| service.properties.get(key).map(|text| excerpt(text));
    // An address of IPv4 needs no interface, and stands first.
    let address = service.addresses.iter().min_by_key(|ip| (ip.is_ipv6(), **ip));
    let address = address.copied().unwrap_or(from);
    FoundCast {
        id: property("id").unwrap_or_else(|| excerpt(&service.name)),
        name: property("fn").unwrap_or_default(),
        model: property("md").unwrap_or_default(),
        address: CastAddress::of(address, service.port).to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_has_a_name_and_an_address_also_where_its_answer_lacks_them() {
        let from = "10.0.0.9".parse().expect("an IP");
        let bare = DnsService { name: "Cast-1._x".to_owned(), ..DnsService::default() };
        let found = read(&bare, from);
        assert_eq!((found.id.as_str(), found.address.as_str()), ("Cast-1._x", "10.0.0.9"));
        let addresses = ["fe80::1", "10.0.0.8"].map(|ip| ip.parse().expect("an IP"));
        let group = DnsService { port: Some(32_187), addresses: addresses.to_vec(), ..bare };
        assert_eq!(read(&group, from).address, "10.0.0.8:32187");
    }

    #[tokio::test]
    async fn a_network_without_answers_has_no_chromecasts() {
        let silent = UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
        let to = silent.local_addr().expect("an address");
        let found = discover(to, Duration::from_millis(100)).await;
        assert_eq!(found, Ok(Vec::new()));
    }
}

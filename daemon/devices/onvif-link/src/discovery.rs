//! Finds the cameras in a network by WS-Discovery: a question to all devices, which every ONVIF
//! device answers.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4};
use std::time::Duration;

use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use tokio::net::UdpSocket;
use tokio::time::Instant;

use crate::address::Address;
use crate::digest::hex;
use crate::error::excerpt;
use crate::xml::Element;

/// Group and port of WS-Discovery.
pub const WS_DISCOVERY: SocketAddr =
    SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::new(239, 255, 255, 250), 3702));

/// Maximum number of devices; further ones are ignored.
const DEVICES_MAX: usize = 256;

/// Maximum length of an answer, in bytes. A longer answer is cut off, so that it cannot be read.
const ANSWER_BYTES_MAX: usize = 16 << 10;

/// Time after which the question is asked again: datagrams get lost.
const ASK_AGAIN: Duration = Duration::from_millis(500);

/// Maximum number of network interfaces on which the question is asked.
const INTERFACES_MAX: usize = 16;

/// A device that has answered.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FoundCamera {
    /// Identifier of the device, which stays the same, such as `urn:uuid:…`.
    pub id: String,
    /// Name of the device for people; empty if the device reports none.
    pub name: String,
    /// Model of the device; empty if the device reports none.
    pub hardware: String,
    /// Whether the device reports that it can turn.
    pub can_turn: bool,
    /// Address of the device, for the `address` of a config.
    pub address: String,
}

/// Asks for devices during the time `lasts`: all in the network if `to` is a group such as
/// [`WS_DISCOVERY`], or else the device at `to`. Returns those that answer, in the order of their
/// identifiers.
///
/// # Errors
///
/// Returns an error if no question can be sent. Its text completes “failed to …”.
pub async fn discover(to: SocketAddr, lasts: Duration) -> Result<Vec<FoundCamera>, String> {
    let sockets = sockets(to).await?;
    let (found, deadline) = (std::sync::Mutex::new(BTreeMap::new()), Instant::now() + lasts);
    let mut asking: Vec<_> = Vec::new();
    for socket in &sockets {
        asking.push(Box::pin(ask(socket, to, deadline, &found)));
    }
    let mut problem = None;
    for asked in join(asking).await {
        problem = problem.or(asked.err());
    }
    let found = found.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    match problem {
        Some(problem) if found.is_empty() => Err(format!("look for cameras: {problem}")),
        _ => Ok(found.into_values().collect()),
    }
}

/// Waits for all futures at once.
async fn join<F: Future + Unpin>(mut futures: Vec<F>) -> Vec<F::Output> {
    let mut ended = Vec::new();
    std::future::poll_fn(|context| {
        futures.retain_mut(|future| match std::pin::Pin::new(future).poll(context) {
            std::task::Poll::Ready(output) => {
                ended.push(output);
                false
            }
            std::task::Poll::Pending => true,
        });
        if futures.is_empty() { std::task::Poll::Ready(()) } else { std::task::Poll::Pending }
    })
    .await;
    ended
}

/// Opens a socket for a device, or one per network interface for a group of devices: a question to
/// a group leaves on the interface of the address from which it is sent.
async fn sockets(to: SocketAddr) -> Result<Vec<UdpSocket>, String> {
    let from = match to.ip() {
        IpAddr::V4(ip) if ip.is_multicast() => own_addresses(),
        IpAddr::V4(_) => vec![IpAddr::V4(Ipv4Addr::UNSPECIFIED)],
        IpAddr::V6(_) => vec![IpAddr::V6(std::net::Ipv6Addr::UNSPECIFIED)],
    };
    let (mut sockets, mut problem) = (Vec::new(), "there is no network".to_owned());
    for from in from {
        match UdpSocket::bind(SocketAddr::new(from, 0)).await {
            Ok(socket) => sockets.push(socket),
            Err(error) => problem = error.to_string(),
        }
    }
    if sockets.is_empty() {
        return Err(format!("look for cameras: {problem}"));
    }
    Ok(sockets)
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
    deadline: Instant,
    found: &std::sync::Mutex<BTreeMap<String, FoundCamera>>,
) -> Result<(), String> {
    let mut buffer = vec![0; ANSWER_BYTES_MAX];
    let question = question()?;
    let mut next_question = Instant::now();
    let mut questions_left = 2;
    loop {
        if questions_left > 0 && Instant::now() >= next_question {
            questions_left -= 1;
            next_question = Instant::now() + ASK_AGAIN;
            let sent = socket.send_to(question.as_bytes(), to).await;
            sent.map_err(|error| error.to_string())?;
        }
        let until = if questions_left > 0 { next_question.min(deadline) } else { deadline };
        match tokio::time::timeout_at(until, socket.recv_from(&mut buffer)).await {
            Ok(Ok((length, from))) => {
                let answer = buffer.get(..length).unwrap_or_default();
                let mut found = found.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                for camera in read(answer, from.ip()) {
                    if found.len() < DEVICES_MAX {
                        found.entry(camera.id.clone()).or_insert(camera);
                    }
                }
            }
            // A device of an earlier question is away.
            Ok(Err(error)) if error.kind() == std::io::ErrorKind::ConnectionRefused => (),
            Ok(Err(error)) => return Err(error.to_string()),
            Err(_) if Instant::now() >= deadline => return Ok(()),
            Err(_) => (),
        }
    }
}

fn question() -> Result<String, String> {
    let id = crate::session::random().map_err(|error| error.to_string())?;
    let id = hex(&id);
    let part = |range| id.get(range).unwrap_or_default();
    let id = format!(
        "{}-{}-{}-{}-{}",
        part(0..8),
        part(8..12),
        part(12..16),
        part(16..20),
        part(20..32)
    );
    Ok(format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\
         <s:Envelope xmlns:s=\"http://www.w3.org/2003/05/soap-envelope\" \
         xmlns:a=\"http://schemas.xmlsoap.org/ws/2004/08/addressing\" \
         xmlns:d=\"http://schemas.xmlsoap.org/ws/2005/04/discovery\" \
         xmlns:dn=\"http://www.onvif.org/ver10/network/wsdl\"><s:Header>\
         <a:MessageID>urn:uuid:{id}</a:MessageID>\
         <a:To>urn:schemas-xmlsoap-org:ws:2005:04:discovery</a:To>\
         <a:Action>http://schemas.xmlsoap.org/ws/2005/04/discovery/Probe</a:Action>\
         </s:Header><s:Body><d:Probe><d:Types>dn:NetworkVideoTransmitter</d:Types></d:Probe>\
         </s:Body></s:Envelope>"
    ))
}

/// Returns the devices in an answer from `from`. An answer that cannot be read has none.
fn read(answer: &[u8], from: IpAddr) -> Vec<FoundCamera> {
    let Ok(answer) = Element::parse(answer) else { return Vec::new() };
    let Some(matches) = answer.at(&["Body", "ProbeMatches"]) else { return Vec::new() };
    let device = |element: &Element| {
        let id = excerpt(element.text_at(&["EndpointReference", "Address"])?);
        let named = element.text_at(&["XAddrs"]).unwrap_or_default();
        let addresses: Vec<_> =
            named.split_whitespace().filter_map(|one| Address::parse(one).ok()).collect();
        // A device with several networks names an address of each.
        let is_near = |one: &&Address| one.host.parse() == Ok(from);
        let address = addresses.iter().find(is_near).or(addresses.first())?;
        let scopes = element.text_at(&["Scopes"]).unwrap_or_default();
        let scope = |kind: &str| {
            let value = scopes.split_whitespace().find_map(|scope| {
                scope.strip_prefix("onvif://www.onvif.org/")?.strip_prefix(kind)?.strip_prefix('/')
            });
            value.map(decoded).unwrap_or_default()
        };
        Some(FoundCamera {
            id,
            name: scope("name"),
            hardware: scope("hardware"),
            can_turn: scopes
                .split_whitespace()
                .any(|scope| scope.eq_ignore_ascii_case("onvif://www.onvif.org/type/ptz")),
            address: address.text(),
        })
    };
    matches.all("ProbeMatch").filter_map(device).collect()
}

/// Returns a part of a URI with its percent escapes decoded.
fn decoded(part: &str) -> String {
    let mut bytes = Vec::with_capacity(part.len());
    let mut rest = part.bytes();
    while let Some(byte) = rest.next() {
        let mut ahead = rest.clone();
        let digits = (ahead.next(), ahead.next());
        let digit = |byte: Option<u8>| char::from(byte?).to_digit(16);
        match (byte, digit(digits.0), digit(digits.1)) {
            (b'%', Some(high), Some(low)) => {
                bytes.push((high * 16 + low) as u8);
                rest = ahead;
            }
            _ => bytes.push(byte),
        }
    }
    excerpt(&String::from_utf8_lossy(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(address: &str, scopes: &str) -> String {
        format!(
            "<e:Envelope xmlns:e='urn:e'><e:Body><d:ProbeMatches xmlns:d='urn:d'><d:ProbeMatch>\
             <a:EndpointReference xmlns:a='urn:a'><a:Address>urn:uuid:1</a:Address>\
             </a:EndpointReference><d:Types>dn:NetworkVideoTransmitter</d:Types>\
             <d:Scopes>{scopes}</d:Scopes><d:XAddrs>{address}</d:XAddrs>\
             </d:ProbeMatch></d:ProbeMatches></e:Body></e:Envelope>"
        )
    }

    #[test]
    fn an_answer_names_the_device_and_its_nearest_address() {
        let scopes = "onvif://www.onvif.org/type/ptz onvif://www.onvif.org/name/Hall%20Camera \
                      onvif://www.onvif.org/hardware/IPC-42";
        let addresses = "http://192.168.1.9/onvif/device_service \
                         http://10.0.0.9:8000/onvif/device_service";
        let found = read(answer(addresses, scopes).as_bytes(), "10.0.0.9".parse().expect("an IP"));
        let expected = FoundCamera {
            id: "urn:uuid:1".to_owned(),
            name: "Hall Camera".to_owned(),
            hardware: "IPC-42".to_owned(),
            can_turn: true,
            address: "10.0.0.9:8000".to_owned(),
        };
        assert_eq!(found, [expected]);
    }

    #[test]
    fn an_answer_that_cannot_be_read_has_no_device() {
        let from = "10.0.0.9".parse().expect("an IP");
        for text in ["", "<a/>", "\u{0}", &answer("", ""), &answer("gopher://x", "%")] {
            assert_eq!(read(text.as_bytes(), from), []);
        }
        let found = read(answer("http://x/onvif/device", "").as_bytes(), from);
        let address = found.first().map(|one| one.address.as_str());
        assert_eq!(address, Some("http://x/onvif/device"), "another path than the usual one");
        let found = read(answer("http://x/", "onvif://www.onvif.org/name/%zz%4").as_bytes(), from);
        assert_eq!(found.first().map(|one| one.name.as_str()), Some("%zz%4"));
    }

    #[tokio::test]
    async fn a_device_that_is_asked_alone_is_found_among_garbage() {
        let device = UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
        let to = device.local_addr().expect("an address");
        let answering = tokio::spawn(async move {
            let mut buffer = [0; 4_096];
            let (length, from) = device.recv_from(&mut buffer).await.expect("a question");
            let question = Element::parse(&buffer[..length]).expect("XML");
            assert!(question.at(&["Body", "Probe", "Types"]).is_some());
            let answer = answer("http://127.0.0.1:1/onvif/device_service", "");
            for text in ["garbage", &answer, &answer] {
                device.send_to(text.as_bytes(), from).await.expect("sent");
            }
        });
        let found = discover(to, Duration::from_millis(300)).await.expect("it is asked");
        answering.await.expect("it answers");
        assert_eq!(found.len(), 1);
    }
}

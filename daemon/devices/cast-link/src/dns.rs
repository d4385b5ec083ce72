//! Multicast DNS, as far as a search for a service needs it: the question, and the records of an
//! answer (RFC 1035, RFC 6762, RFC 6763).

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

/// Maximum number of records of an answer; further ones are ignored.
const RECORDS_MAX: usize = 256;

/// Maximum length of a name, in bytes. A name whose pointers lead in a circle is longer.
const NAME_BYTES_MAX: usize = 255;

/// Types of records.
const A: u16 = 1;
const PTR: u16 = 12;
const TXT: u16 = 16;
const AAAA: u16 = 28;
const SRV: u16 = 33;

/// Class of the internet, and the flag with which a question asks for an answer to itself alone.
const INTERNET: u16 = 1;
const TO_ME: u16 = 0x8000;

/// Length of the fields that begin a message, in bytes.
const HEADER_BYTES: usize = 12;

/// A service in an answer.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct DnsService {
    /// Full name of the service.
    pub(crate) name: String,
    pub(crate) port: Option<u16>,
    pub(crate) addresses: Vec<IpAddr>,
    /// What the service says about itself.
    pub(crate) properties: BTreeMap<String, String>,
}

/// Returns the question for all services of a kind, such as `_googlecast._tcp.local`.
pub(crate) fn question(kind: &str) -> Vec<u8> {
    // One question, and nothing else.
    let mut bytes = vec![0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0];
    for label in kind.split('.') {
        // A label of our own has at most 63 bytes.
        bytes.push(label.len() as u8);
        bytes.extend(label.as_bytes());
    }
    bytes.push(0);
    bytes.extend(PTR.to_be_bytes());
    bytes.extend((INTERNET | TO_ME).to_be_bytes());
    bytes
}

/// Returns the services of this kind in an answer. What cannot be read is left out.
pub(crate) fn services(answer: &[u8], kind: &str) -> Vec<DnsService> {
    let mut found: BTreeMap<String, DnsService> = BTreeMap::new();
    let (mut hosts, mut targets) = (BTreeMap::<_, Vec<_>>::new(), Vec::new());
    for record in records(answer).unwrap_or_default() {
        let DnsRecord { name, data } = record;
        match data {
            DnsData::Pointer(service) if name.eq_ignore_ascii_case(kind) => {
                let entry = found.entry(service.clone()).or_default();
                entry.name = service;
            }
            DnsData::Host(address) => hosts.entry(name).or_default().push(address),
            data => targets.push((name, data)),
        }
    }
    for (name, data) in targets {
        let Some(service) = found.get_mut(&name) else { continue };
        match data {
            DnsData::Server(host, port) => {
                service.port = Some(port);
                service.addresses = hosts.get(&host).cloned().unwrap_or_default();
            }
            DnsData::Text(properties) => service.properties = properties,
            DnsData::Pointer(_) | DnsData::Host(_) => (),
        }
    }
    found.into_values().collect()
}

/// A record of an answer.
struct DnsRecord {
    name: String,
    data: DnsData,
}

enum DnsData {
    Pointer(String),
    Server(String, u16),
    Text(BTreeMap<String, String>),
    Host(IpAddr),
}

/// Returns the records of an answer that concern services; `None` if it is none or is cut off.
fn records(answer: &[u8]) -> Option<Vec<DnsRecord>> {
    let count = |at: usize| number(answer, at).map(usize::from);
    // The first bit after the identifier tells an answer from a question.
    if answer.get(2)? & 0x80 == 0 {
        return None;
    }
    let mut at = HEADER_BYTES;
    for _ in 0..count(4)? {
        at = name(answer, at)?.1 + 4;
    }
    let total = count(6)? + count(8)? + count(10)?;
    let mut records = Vec::new();
    for _ in 0..total.min(RECORDS_MAX) {
        let Some((record, next)) = record(answer, at) else { break };
        records.extend(record);
        at = next;
    }
    Some(records)
}

/// Reads the record at `at`. Returns it, if it concerns services, and the place after it.
fn record(answer: &[u8], at: usize) -> Option<(Option<DnsRecord>, usize)> {
    let (owner, at) = name(answer, at)?;
    let (kind, length) = (number(answer, at)?, usize::from(number(answer, at + 8)?));
    let start = at + 10;
    let bytes = answer.get(start..start + length)?;
    let data = match kind {
        PTR => name(answer, start).map(|(name, _)| DnsData::Pointer(name)),
        SRV => number(bytes, 4)
            .zip(name(answer, start + 6))
            .map(|(port, (host, _))| DnsData::Server(host, port)),
        TXT => Some(DnsData::Text(properties(bytes))),
        A => <[u8; 4]>::try_from(bytes).ok().map(|ip| DnsData::Host(Ipv4Addr::from(ip).into())),
        AAAA => <[u8; 16]>::try_from(bytes).ok().map(|ip| DnsData::Host(Ipv6Addr::from(ip).into())),
        _ => None,
    };
    Some((data.map(|data| DnsRecord { name: owner, data }), start + length))
}

fn number(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

/// Reads the name at `at`, which may continue elsewhere by a pointer. Returns it, and the place after
/// it. A dot within a label is not told from the dot between two labels.
fn name(answer: &[u8], mut at: usize) -> Option<(String, usize)> {
    let (mut text, mut end) = (Vec::new(), None);
    loop {
        let length = usize::from(*answer.get(at)?);
        if length & 0xc0 == 0xc0 {
            end = end.or(Some(at + 2));
            let to = (length & 0x3f) << 8 | usize::from(*answer.get(at + 1)?);
            // A pointer leads back, so that a circle cannot be endless.
            if to >= at {
                return None;
            }
            at = to;
            continue;
        }
        if length == 0 {
            let text = String::from_utf8_lossy(&text).into_owned();
            return Some((text, end.unwrap_or(at + 1)));
        }
        if !text.is_empty() {
            text.push(b'.');
        }
        text.extend(answer.get(at + 1..at + 1 + length)?);
        if text.len() > NAME_BYTES_MAX {
            return None;
        }
        at += 1 + length;
    }
}

/// Reads the properties of a service: texts `KEY=VALUE`, each with its length.
fn properties(mut bytes: &[u8]) -> BTreeMap<String, String> {
    let mut properties = BTreeMap::new();
    while let Some((&length, rest)) = bytes.split_first() {
        let Some((text, rest)) = rest.split_at_checked(usize::from(length)) else { break };
        bytes = rest;
        let text = String::from_utf8_lossy(text);
        if let Some((key, value)) = text.split_once('=') {
            properties.insert(key.to_ascii_lowercase(), value.to_owned());
        }
    }
    properties
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: &str = "_googlecast._tcp.local";

    /// An answer with pointers in its names, as devices send it.
    fn answer() -> Vec<u8> {
        let mut bytes = vec![0, 0, 0x84, 0, 0, 0, 0, 1, 0, 0, 0, 3];
        bytes.extend(b"\x0b_googlecast\x04_tcp\x05local\0");
        // PTR to `Cast-1` and the name at 12.
        bytes.extend([0, 12, 0, 1, 0, 0, 0, 120, 0, 9]);
        bytes.extend(b"\x06Cast-1\xc0\x0c");
        let service = bytes.len() - 9;
        let pointer = [0xc0, service as u8];
        bytes.extend(pointer);
        bytes.extend([0, 16, 0x80, 1, 0, 0, 0, 120, 0, 12]);
        bytes.extend(b"\x05fn=TV\x05md=CC");
        bytes.extend(pointer);
        bytes.extend([0, 33, 0x80, 1, 0, 0, 0, 120, 0, 11, 0, 0, 0, 0, 0x1f, 0x49]);
        bytes.extend(b"\x02tv\xc0");
        bytes.push(12 + 17);
        bytes.extend(b"\x02tv\xc0");
        bytes.push(12 + 17);
        bytes.extend([0, 1, 0x80, 1, 0, 0, 0, 120, 0, 4, 10, 0, 0, 7]);
        bytes
    }

    #[test]
    fn a_service_has_its_port_its_address_and_its_properties() {
        let properties = [("fn", "TV"), ("md", "CC")];
        let service = DnsService {
            name: format!("Cast-1.{KIND}"),
            port: Some(8009),
            addresses: vec!["10.0.0.7".parse().expect("an IP")],
            properties: properties.map(|(k, v)| (k.to_owned(), v.to_owned())).into(),
        };
        assert_eq!(services(&answer(), KIND), [service]);
        assert_eq!(services(&answer(), "_ipp._tcp.local"), []);
    }

    #[test]
    fn a_question_has_no_services_and_names_the_kind() {
        let question = question(KIND);
        assert_eq!(services(&question, KIND), []);
        assert_eq!(name(&question, HEADER_BYTES), Some((KIND.to_owned(), question.len() - 4)));
    }

    #[test]
    fn answers_that_are_cut_changed_or_go_in_circles_cause_no_panic() {
        let whole = answer();
        for end in 0..whole.len() {
            assert!(services(&whole[..end], KIND).len() <= 1);
        }
        for at in 0..whole.len() {
            for value in [0, 0x3f, 0xc0, 0xff] {
                let mut changed = whole.clone();
                changed[at] = value;
                let _ = services(&changed, KIND);
            }
        }
        let mut circle = vec![0, 0, 0x84, 0, 0, 0, 0, 1, 0, 0, 0, 0];
        circle.extend([0xc0, 12, 0, 12, 0, 1, 0, 0, 0, 120, 0, 2, 0xc0, 12]);
        assert_eq!(services(&circle, KIND), []);
    }
}

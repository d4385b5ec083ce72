//! Restarts this process when the machine has moved to another address: its DHCP lease was not
//! renewed, or it has roamed to another network.
//!
//! All links of the process use the old address, and are dead. Zenoh scouts from the addresses that
//! existed when Zenoh was started, so that it would find no daemon from the new address. Other
//! daemons count this daemon as gone already, so that a restart loses nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::net::Ipv4Addr;
use std::thread;
use std::time::Duration;

use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;

use super::reexec::restart_process;

/// How often the machine's addresses are checked. Other daemons count this one as gone only after a
/// lease, which is longer.
const PERIOD: Duration = Duration::from_secs(1);

/// The addresses that scouting can use, by network interface. Scouting uses IPv4.
type Addresses = BTreeMap<String, BTreeSet<Ipv4Addr>>;

/// Watches the machine's addresses on a separate thread, and restarts this process when the machine
/// has moved to another address.
pub(crate) fn watch_addresses() {
    let Some(first) = addresses() else { return };
    thread::spawn(move || {
        loop {
            thread::sleep(PERIOD);
            let Some(now) = addresses() else { continue };
            if let Some((interface, address)) = moved(&first, &now) {
                tracing::warn!(interface, %address, "this machine has a new address: restarts");
                restart_process();
                return;
            }
        }
    });
}

fn addresses() -> Option<Addresses> {
    let mut all = Addresses::new();
    for each in getifaddrs().ok()? {
        let is_beyond = each.flags.contains(InterfaceFlags::IFF_MULTICAST)
            && !each.flags.contains(InterfaceFlags::IFF_LOOPBACK);
        let address = each.address.and_then(|address| Some(address.as_sockaddr_in()?.ip()));
        if let Some(address) = address.filter(|_| is_beyond) {
            all.entry(each.interface_name).or_default().insert(address);
        }
    }
    Some(all)
}

/// Returns the new interface and address if the machine has moved; otherwise `None`. The machine
/// has moved if an interface has kept none of its old addresses, or if there were no addresses at
/// all before. An added interface alone is not a move, because bridges and tunnels are added and
/// removed all the time.
fn moved<'now>(first: &Addresses, now: &'now Addresses) -> Option<(&'now str, Ipv4Addr)> {
    let has_moved = |interface: &str, here: &BTreeSet<Ipv4Addr>| match first.get(interface) {
        Some(before) => before.is_disjoint(here),
        None => first.is_empty(),
    };
    let (interface, here) = now.iter().find(|(interface, here)| has_moved(interface, here))?;
    Some((interface, *here.first()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at<const N: usize>(all: [(&str, &[u8]); N]) -> Addresses {
        let address = |last: &u8| Ipv4Addr::new(10, 0, 0, *last);
        let of = |last: &[u8]| last.iter().map(address).collect();
        all.into_iter().map(|(interface, last)| (interface.to_owned(), of(last))).collect()
    }

    #[track_caller]
    fn check(first: &Addresses, now: Addresses, expected: Option<(&str, u8)>) {
        let moved = moved(first, &now).map(|(interface, at)| (interface, at.octets()[3]));
        assert_eq!(moved, expected, "{first:?} to {now:?}");
    }

    #[test]
    fn a_kept_address_is_no_move() {
        let first = at([("eth0", &[3]), ("wlan0", &[4, 5])]);
        check(&first, first.clone(), None);
        check(&first, at([("eth0", &[3]), ("wlan0", &[5, 6])]), None);
        check(&first, at([("eth0", &[3])]), None);
        check(&first, at([]), None);
        check(&first, at([("docker0", &[7]), ("eth0", &[3]), ("wlan0", &[4])]), None);
        check(&first, at([("eth0", &[3]), ("wlan0", &[6])]), Some(("wlan0", 6)));
    }

    #[test]
    fn a_first_address_is_a_move() {
        check(&at([]), at([]), None);
        check(&at([]), at([("eth0", &[3])]), Some(("eth0", 3)));
    }

    #[test]
    fn loopback_addresses_do_not_count() {
        let here = addresses().expect("the kernel tells");
        assert!(here.values().flatten().all(|address| !address.is_loopback()), "{here:?}");
    }
}

//! Search for the endpoints to connect to that belong to this daemon itself. One ecosystem file for
//! all machines names every daemon, but no daemon connects to itself.

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::net::{IpAddr, ToSocketAddrs as _};
use std::time::Duration;

use nix::ifaddrs::{InterfaceAddress, getifaddrs};
use serde_json::Value;
use tracing::field::{Field, Visit};
use tracing::{Event, Metadata};
use tracing_subscriber::layer::{Context, Filter};

use crate::endpoint;

/// Target under which Zenoh logs that a link could not be made.
const ESTABLISHMENT: &str = "zenoh_transport::unicast::establishment";

/// How long the resolution of host names may take. A name that is resolved later counts as the name
/// of another machine; Zenoh then closes the daemon's link to itself.
const RESOLVED_WITHIN: Duration = Duration::from_secs(2);

/// Returns the endpoints in `connect` at which this daemon itself listens.
pub(crate) async fn own(listen: &[String], connect: &[String]) -> BTreeSet<String> {
    let places: Vec<_> = listen.iter().filter_map(|each| place(each)).collect();
    let mut own = BTreeSet::new();
    let mut looking = Vec::new();
    for endpoint in connect {
        if listen.contains(endpoint) {
            own.insert(endpoint.clone());
            continue;
        }
        let Some((host, port)) = place(endpoint) else { continue };
        let same_port: Vec<String> =
            places.iter().filter(|(_, at)| *at == port).map(|(host, _)| host.clone()).collect();
        if !same_port.is_empty() {
            let endpoint = endpoint.clone();
            let look = move || is_own(&host, port, &same_port).then_some(endpoint);
            looking.push(tokio::task::spawn_blocking(look));
        }
    }
    let deadline = tokio::time::Instant::now() + RESOLVED_WITHIN;
    for look in looking {
        if let Ok(Ok(found)) = tokio::time::timeout_at(deadline, look).await {
            own.extend(found);
        }
    }
    own
}

/// Removes endpoints from a setting that may have any of the shapes that Zenoh allows.
pub(crate) fn without(value: &mut Value, own: &BTreeSet<String>) {
    match value {
        Value::Array(list) => {
            list.retain(|each| each.as_str().is_none_or(|endpoint| !own.contains(endpoint)));
            list.iter_mut().for_each(|each| without(each, own));
        }
        Value::Object(table) => table.values_mut().for_each(|each| without(each, own)),
        _ => (),
    }
}

/// Returns a log filter that drops the lines in which Zenoh reports a link of the daemon to itself,
/// which Zenoh closes. Such links can still occur: a host name that did not resolve at the start
/// may become a name of this machine later.
pub fn self_link_filter<S>() -> impl Filter<S> {
    SelfLinkFilter
}

struct SelfLinkFilter;

impl<S> Filter<S> for SelfLinkFilter {
    fn enabled(&self, _: &Metadata<'_>, _: &Context<'_, S>) -> bool {
        true
    }

    fn event_enabled(&self, event: &Event<'_>, _: &Context<'_, S>) -> bool {
        if !event.metadata().target().starts_with(ESTABLISHMENT) {
            return true;
        }
        let mut line = SelfLinkVisitor::default();
        event.record(&mut line);
        !line.is_to_self
    }
}

#[derive(Default)]
struct SelfLinkVisitor {
    is_to_self: bool,
}

impl Visit for SelfLinkVisitor {
    fn record_debug(&mut self, _: &Field, value: &dyn Debug) {
        self.is_to_self |= format!("{value:?}").contains("CONNECTION_TO_SELF");
    }
}

/// Returns host and port of an endpoint over IP; `None` for other endpoints and for port 0.
fn place(endpoint: &str) -> Option<(String, u16)> {
    let (host, port) = endpoint::host_and_port(endpoint)?;
    (port != 0).then_some((host, port))
}

/// Whether `host` is an address of this machine, and one of the endpoints in `listening` accepts
/// connections to it.
fn is_own(host: &str, port: u16, listening: &[String]) -> bool {
    let called = resolved(host, port);
    listening.iter().any(|at| {
        let is_any = at.parse().is_ok_and(|ip: IpAddr| ip.is_unspecified());
        let here = resolved(at, port);
        called.iter().any(|called| here.contains(called) || is_any && is_of_this_machine(*called))
    })
}

fn resolved(host: &str, port: u16) -> Vec<IpAddr> {
    // A name that cannot be resolved has no addresses.
    let addresses = (host, port).to_socket_addrs().into_iter().flatten();
    addresses.map(|address| address.ip().to_canonical()).collect()
}

/// Whether a network interface of this machine has the address. (Binding to the address would prove
/// nothing where `net.ipv4.ip_nonlocal_bind` is set.)
fn is_of_this_machine(address: IpAddr) -> bool {
    let has_it = |interface: InterfaceAddress| {
        let of = interface.address?;
        let own: IpAddr = match (of.as_sockaddr_in(), of.as_sockaddr_in6()) {
            (Some(v4), _) => v4.ip().into(),
            (None, v6) => v6?.ip().into(),
        };
        Some(own == address)
    };
    // All addresses in 127.0.0.0/8 belong to this machine, and only one of them is the address of
    // an interface.
    address.is_loopback()
        || getifaddrs().is_ok_and(|mut all| all.any(|it| has_it(it) == Some(true)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_daemon_recognises_itself_under_every_name() {
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").expect("a name");
        let by_name = format!("tls/{}:7461", host.trim());
        let is_named = !resolved(host.trim(), 7461).is_empty();
        let everywhere = ["tls/0.0.0.0:7461".to_owned(), "unixsock-stream//run/a.sock".to_owned()];
        for (endpoint, expected) in [
            ("tls/127.0.0.1:7461", true),
            ("tls/127.9.9.9:7461", true),
            ("tls/localhost:7461", true),
            ("tls/127.0.0.1:7461#so_rcvbuf=1", true),
            (&by_name, is_named),
            ("unixsock-stream//run/a.sock", true),
            ("tls/127.0.0.1:7462", false),
            ("tls/192.0.2.1:7461", false),
            ("tls/nobody.invalid:7461", false),
            ("unixsock-stream//run/b.sock", false),
        ] {
            let found = own(&everywhere, &[endpoint.to_owned()]).await;
            assert_eq!(found.contains(endpoint), expected, "{endpoint}");
        }
    }

    #[tokio::test]
    async fn a_daemon_at_one_address_may_connect_to_another() {
        let here = ["tls/127.0.0.1:7461".to_owned()];
        for (endpoint, expected) in [
            ("tls/127.0.0.1:7461", true),
            ("tls/localhost:7461", true),
            ("tls/[::ffff:127.0.0.1]:7461", true),
            ("tls/127.0.0.2:7461", false),
        ] {
            let found = own(&here, &[endpoint.to_owned()]).await;
            assert_eq!(found.contains(endpoint), expected, "{endpoint}");
        }
        // The kernel chooses the port, so no file can name it.
        assert!(
            own(&["tls/0.0.0.0:0".to_owned()], &["tls/127.0.0.1:7461".to_owned()]).await.is_empty()
        );
    }

    #[test]
    fn own_endpoints_are_removed_from_lists_of_any_shape() {
        let own = BTreeSet::from(["a".to_owned()]);
        let mut list = serde_json::json!({ "router": ["a", "b"], "peer": ["a"] });
        without(&mut list, &own);
        assert_eq!(list, serde_json::json!({ "router": ["b"], "peer": [] }));
    }
}

//! Checks the table `[zenoh]`: endpoints that cannot be reached, and settings that Zenoh does not
//! have. Checks all addresses at which a daemon listens: no two services can have the same.

use std::net::SocketAddr;

use pddl::{Diagnostic, Span};

use super::Reviewer;

/// The first port that a correction names: that of the page in all examples.
const PORT_EXAMPLE: u16 = 8650;

impl Reviewer<'_> {
    /// Reports the mistakes in the table `[zenoh]`.
    pub(super) fn network(&mut self) {
        let ecosystem = self.ecosystem;
        let is_secured = ecosystem.security.is_some();
        for problem in substrate_zenoh::problems(&ecosystem.name, &ecosystem.zenoh, is_secured) {
            let path = match problem.at.as_str() {
                "" => "zenoh".to_owned(),
                at => format!("zenoh.{at}"),
            };
            let message = format!("failed to {}", problem.message);
            self.report_value(&path, Diagnostic::error(Span::default(), message));
        }
        self.shared_addresses();
        if !is_secured {
            self.plain_connections();
        }
    }

    /// Warns about connections over which messages leave this machine as plain text: listening beyond
    /// the machine needs `[security]`, and a router elsewhere does not ask for it.
    fn plain_connections(&mut self) {
        for (path, endpoint) in substrate_zenoh::plain_connections(&self.ecosystem.zenoh) {
            let message = format!(
                "messages go to `{endpoint}` as plain text: all hosts on the way read them"
            );
            let help = "write [security], and the endpoint with tls/ (docs/security.md)";
            let found = Diagnostic::warning(Span::default(), message).with_help(help);
            self.report_value(&format!("zenoh.{path}"), found);
        }
    }

    /// Reports each address at which an earlier service listens already.
    fn shared_addresses(&mut self) {
        let listeners = self.listeners();
        for (index, (path, address)) in listeners.iter().enumerate() {
            let earlier = listeners[..index].iter().find(|(_, other)| overlap(*address, *other));
            if let Some((other, _)) = earlier {
                let message = format!("`{path}` and `{other}` are one address");
                let help = format!("give it another port, such as {}", free_port(&listeners));
                self.report_value(
                    path,
                    Diagnostic::error(Span::default(), message).with_help(help),
                );
            }
        }
    }

    /// Returns all addresses at which a daemon listens, each with its path in the ecosystem file.
    fn listeners(&self) -> Vec<(String, SocketAddr)> {
        let ecosystem = self.ecosystem;
        let zenoh = substrate_zenoh::listen_addresses(&ecosystem.zenoh);
        let zenoh = zenoh.into_iter().map(|(path, address)| (format!("zenoh.{path}"), address));
        let web = ecosystem.web.as_ref().map(|web| ("web.listen".to_owned(), web.listen));
        let metrics = ecosystem.metrics.map(|address| ("metrics.listen".to_owned(), address));
        zenoh.chain(web).chain(metrics).collect()
    }
}

/// Whether two listeners would receive the same connections. The kernel chooses port 0 anew for each.
fn overlap(one: SocketAddr, other: SocketAddr) -> bool {
    let is_same_host = one.ip() == other.ip()
        || one.is_ipv4() == other.is_ipv4()
            && (one.ip().is_unspecified() || other.ip().is_unspecified());
    one.port() != 0 && one.port() == other.port() && is_same_host
}

/// Returns a port that no listener has.
fn free_port(listeners: &[(String, SocketAddr)]) -> u16 {
    let is_free = |port: &u16| listeners.iter().all(|(_, address)| address.port() != *port);
    (PORT_EXAMPLE..=u16::MAX).find(is_free).unwrap_or(PORT_EXAMPLE)
}

//! Serves the metrics and the health of a daemon (docs/metrics.md).
//!
//! On an address of this machine alone, everyone is answered. On another address, which only a
//! secured ecosystem may have, TLS lets in who has a certificate of the ecosystem's authority.
//!
//! A daemon that cannot open the socket continues without it and tries again: figures for operators
//! must not keep a building from its work.

mod families;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use agent::{DaemonFigures, MessageRouter, StopRegistry};
use metrics_endpoint::{
    Health, MetricFamily, MetricsListener, MetricsSource, TlsError, TlsFiles, TlsServer,
};
use substrate_zenoh::Security;

use super::{DaemonNode, MessageTransport, SharedNames};

/// Wait before the next attempt to open the socket. Another program that has the port may end.
const TRY_AGAIN: Duration = Duration::from_secs(10);

/// How long a record that could not be written counts as a problem of the daemon.
const RECORD_REMEMBERED: Duration = Duration::from_secs(60);

/// Maximum number of absent agents that the health names one by one.
const NAMED_MAX: usize = 20;

/// The daemon that is observed.
struct DaemonObserver {
    router: Arc<MessageRouter>,
    stops: Arc<StopRegistry>,
    names: SharedNames,
}

impl DaemonNode {
    /// Serves the metrics and the health of this daemon at `address`, until the daemon stops. Does
    /// nothing if this node is a guest.
    pub(crate) fn serve_metrics(&self, address: SocketAddr) {
        let Some(host) = &self.host else { return };
        let observer = DaemonObserver {
            router: Arc::clone(&self.router),
            stops: host.stops(),
            names: self.names.clone(),
        };
        let tls = match (address.ip().is_loopback(), self.security()) {
            (true, _) => None,
            (false, Some(security)) => match tls_of(security) {
                Ok(tls) => Some(tls),
                Err(error) => return tracing::error!("no metrics are served: failed to {error}"),
            },
            // The configuration allows no such address.
            (false, None) => return,
        };
        let stopping = self.stopping.clone();
        tokio::spawn(async move {
            stopping.run_until_cancelled(serve(address, tls, Arc::new(observer))).await;
        });
    }

    /// Returns the keys of this daemon; `None` if the ecosystem is not secured.
    pub(super) fn security(&self) -> Option<&Security> {
        match &self._wire {
            MessageTransport::Zenoh(config) => config.security.as_ref(),
            MessageTransport::Memory(_) | MessageTransport::Unreliable(..) => None,
        }
    }
}

/// Returns the server's side of TLS, with the certificate that the daemon has for other daemons.
fn tls_of(security: &Security) -> Result<TlsServer, TlsError> {
    let (key, certificate, authority) = security.identity.files();
    let verifier = Arc::clone(&security.verifier);
    let is_revoked = move |certificate: &[u8]| verifier.revoked_subject(certificate).is_some();
    TlsServer::new(&TlsFiles { key, certificate, authority }, is_revoked)
}

async fn serve(address: SocketAddr, tls: Option<TlsServer>, source: Arc<DaemonObserver>) {
    let mut is_said = false;
    let listener = loop {
        match MetricsListener::bind(address, tls.clone()).await {
            Ok(listener) => break listener,
            Err(error) if !is_said => {
                tracing::error!(
                    "no metrics are served: failed to {error}; `listen` in [metrics] says where, \
                     and every daemon of one machine needs an address of its own"
                );
                is_said = true;
            }
            Err(_) => (),
        }
        tokio::time::sleep(TRY_AGAIN).await;
    };
    let scheme = if tls.is_some() { "https" } else { "http" };
    let at = listener.address().unwrap_or(address);
    tracing::info!("metrics are served at {scheme}://{at}/metrics");
    listener.serve(source).await;
}

impl DaemonObserver {
    /// Returns the names of the agents that this daemon hosts and that are not present here.
    fn absent_agents(&self) -> Vec<AgentId> {
        let (directory, daemon) = (self.router.directory(), self.router.daemon());
        let is_here = |agent: &AgentId| {
            directory.all(agent).iter().any(|resident| resident.daemon == *daemon)
        };
        self.names.lock().iter().filter(|agent| !is_here(agent)).cloned().collect()
    }

    fn problems(&self, figures: &DaemonFigures) -> Vec<String> {
        let absent = self.absent_agents();
        let named = absent.iter().take(NAMED_MAX);
        let mut problems: Vec<_> =
            named.map(|agent| format!("the agent `{agent}` does not run")).collect();
        if absent.len() > NAMED_MAX {
            problems.push(format!("and {} other agents", absent.len() - NAMED_MAX));
        }
        if figures.certificate_left == Some(Duration::ZERO) {
            problems.push("the certificate of this daemon has ended".to_owned());
        }
        let last = figures.failures.not_persisted_ago.filter(|ago| *ago < RECORD_REMEMBERED);
        if let Some(ago) = last {
            problems
                .push(format!("a record could not be written to the disk {} s ago", ago.as_secs()));
        }
        problems
    }
}

impl MetricsSource for DaemonObserver {
    fn metrics(&self) -> Vec<MetricFamily> {
        let figures = self.router.figures();
        let is_healthy = self.problems(&figures).is_empty();
        let (process, stops) = (machine::process_figures(), self.stops.in_force().len());
        families::all(&figures, &process, stops, is_healthy)
    }

    fn health(&self) -> Health {
        Health { problems: self.problems(&self.router.figures()) }
    }
}

#[cfg(test)]
mod tests {
    use acl::{DaemonId, EcosystemId, Incarnation};
    use agent::AgentSettings;
    use substrate::{Inbound as _, Presence, Resident};

    use super::*;

    fn observer() -> DaemonObserver {
        let ecosystem = EcosystemId::new("office").expect("a name");
        let daemon = DaemonId::new("here").expect("a name");
        let router = MessageRouter::new(ecosystem, daemon, AgentSettings::default());
        DaemonObserver { router, stops: Arc::default(), names: SharedNames::default() }
    }

    fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    fn join(observer: &DaemonObserver, name: &str, daemon: &str, incarnation: u64) {
        observer.router.presence(Presence::Joined(Resident {
            agent: agent(name),
            daemon: DaemonId::new(daemon).expect("a name"),
            incarnation: Incarnation(incarnation),
        }));
    }

    fn is_healthy(observer: &DaemonObserver) -> bool {
        let families = observer.metrics();
        let family = families.iter().find(|family| family.name == "althing_healthy");
        family.expect("it is served").samples[0].value > 0.5
    }

    #[test]
    fn an_agent_that_is_not_here_is_a_problem() {
        let observer = observer();
        assert_eq!(observer.health(), Health::default());
        assert!(is_healthy(&observer));
        observer.names.lock().insert(agent("lamp"));
        join(&observer, "lamp", "elsewhere", 1);
        assert_eq!(observer.health().problems, ["the agent `lamp` does not run"]);
        assert!(!is_healthy(&observer));
        join(&observer, "lamp", "here", 2);
        assert_eq!(observer.health(), Health::default(), "a standby is here");
    }

    #[test]
    fn many_absent_agents_are_counted() {
        let observer = observer();
        observer.names.lock().extend((0..1_000).map(|number| agent(&format!("lamp-{number}"))));
        let problems = observer.health().problems;
        assert_eq!(problems.len(), NAMED_MAX + 1);
        assert_eq!(problems.last().map(String::as_str), Some("and 980 other agents"));
    }

    #[test]
    fn an_ended_certificate_is_a_problem() {
        let observer = observer();
        observer.router.tell_certificate(|| Duration::ZERO);
        assert_eq!(observer.health().problems, ["the certificate of this daemon has ended"]);
    }
}

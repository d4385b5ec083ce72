//! Machines of a scenario as network namespaces, with TLS between them, so that cables can be
//! pulled.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use acl::{DaemonId, EcosystemId};
use agent::Mode;
use building::Layout;
use credentials::{CredentialFolder, DaemonIdentity, Trust, Verifier};
use substrate_zenoh::{Config, Security};

use crate::house::network::{LAN, Site, is_permitted, secured};
use crate::setting::{REASONING, Setting};
use crate::support::{self, Machine, Outcome};

/// The network to which a pulled cable leads.
const NOWHERE: &str = "nowhere";

/// Maximum number of messages per second that are accepted from one sender: enough for all messages
/// of the benchmark.
const PER_SECOND: u32 = 100_000;

/// All machines of a scenario.
pub(crate) struct Wires {
    site: Site,
    names: Vec<String>,
    /// The folder with the ontology and the map.
    _folder: Machine,
}

/// Whether network namespaces are permitted; if not, prints a note that this part is left out.
pub(crate) fn are_permitted() -> bool {
    is_permitted()
}

impl Wires {
    /// Creates the machines on one network; no daemon runs yet. The building's socket is
    /// [`Wires::socket`].
    pub(crate) fn lay(layout: &Layout, zenoh: &str) -> Outcome<Wires> {
        let folder = Machine::new()?;
        Setting::new("scenario-1", layout).write(folder.path(), None)?;
        let text = std::fs::read_to_string(&folder.file)?;
        let named: BTreeSet<_> =
            support::entries(&text)?.into_iter().map(|entry| entry.daemon).collect();
        // All other daemons connect to the reasoning one, so it comes first.
        let others = named.into_iter().filter(|name| name != REASONING);
        let names: Vec<_> = std::iter::once(REASONING.to_owned()).chain(others).collect();
        let text = format!(
            "{text}\n[zenoh]\nscouting = false\nlisten.endpoints = [\"tls/0.0.0.0:7447\"]\n{zenoh}\n"
        );
        let borrowed: Vec<_> = names.iter().map(String::as_str).collect();
        // The ecosystem file is written to another folder, so the paths become absolute.
        let path = |file: &str| format!("{:?}", folder.path().join(file).display().to_string());
        let text = text
            .replace("\"domain.pddl\"", &path("domain.pddl"))
            .replace("\"map.pddl\"", &path("map.pddl"));
        let office = secured(&text, &borrowed);
        let site = Site::on_lan(office, &borrowed).ok_or("no network namespaces")?;
        site.network(NOWHERE);
        Ok(Wires { site, names, _folder: folder })
    }

    pub(crate) fn socket(&self) -> PathBuf {
        self.site.office.folder().join("building.sock")
    }

    /// Starts all daemons, each connected to those before it; all are ready when this returns.
    pub(crate) fn up(&mut self, mode: Mode) {
        let mode = mode.to_string();
        for (index, name) in self.names.iter().enumerate() {
            let called: Vec<_> = (1..=index).map(|n| format!("tls/10.0.0.{n}:7447")).collect();
            let called = called.iter().flat_map(|each| ["--connect", each]);
            let options: Vec<_> = ["--mode", &mode].into_iter().chain(called).collect();
            self.site.up(name, &options);
        }
    }

    /// Returns the configuration of a guest of the reasoning daemon, with that daemon's key.
    pub(crate) fn client(&self, name: &str) -> Outcome<Config> {
        let keys = CredentialFolder::new(self.site.office.folder().join("keys"));
        let host = DaemonId::new(REASONING)?;
        let guest = host.guest(name)?;
        let trust = Trust::read(&keys)?;
        let identity =
            Arc::new(DaemonIdentity::read(&keys, &host, &trust)?.for_guest(guest.clone()));
        let verifier = Arc::new(Verifier::new(trust, PER_SECOND));
        let mut config = Config::new(EcosystemId::new("scenario-1")?, guest);
        config.security = Some(Security { identity, verifier });
        config.mode = substrate_zenoh::SessionMode::Client;
        let socket = self.site.office.runtime_folder().join("scenario-1/reasoning.sock");
        let socket = self.site.path(REASONING, &socket);
        config.connect = vec![format!("unixsock-stream/{}", socket.display())];
        Ok(config)
    }

    /// Pulls the cable of a machine. No process is notified, and the interface of the machine stays
    /// up.
    pub(crate) fn pull(&self, machine: &str) {
        self.site.replug(machine, LAN, NOWHERE);
    }
}

//! The page of a daemon: observes the ecosystem inside the daemon, serves what is to be seen to
//! browsers, and acts for the people that have signed in.
//!
//! - [`page_view`] keeps the view, and what goals can be about; [`crate::observing`] feeds it.
//! - [`daemon_host`] is the host that the crate `web_page` serves.
//! - [`acts`] carries out what people ask for, through [`person_agents`]: each person has an agent,
//!   so that messages, histories and the rights of the ecosystem carry the name of the person.

mod act_sentences;
mod acts;
mod answered;
pub(crate) mod certificate;
mod daemon_host;
mod history_readers;
mod notifications;
mod page_view;
mod person_agents;
mod pictures;
mod setup;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use accounts::{Accounts, RequestLog};
use acl::{AgentId, DaemonId};
use keyboard::Keyboard;
use substrate::OverhearToken;
use terminal::output;
use tokio::task::{AbortHandle, JoinHandle};
use web_page::{PageOptions, PageServer, PageTls};

use crate::config::{AgentEntry, Ecosystem, WebSettings};
use crate::ecosystem_view::EcosystemView;
use crate::hosting::{self, DaemonNode};
use crate::observing::{self, ObserverPlace, PollHints};

use daemon_host::DaemonHost;
use page_view::{PageInbox, PageView};
use person_agents::PersonAgents;

/// Wait before the next attempt to serve the page. Another program that has the port may end, and a
/// certificate may be made meanwhile.
const TRY_AGAIN: Duration = Duration::from_secs(10);

/// Maximum number of characters of the daemon's name in the name of an agent, which has a maximum
/// length.
const DAEMON_CHARS_MAX: usize = 20;

/// The page while it is served. Dropping it closes all connections, and ends the agents of people.
pub(crate) struct WebPage {
    tasks: Vec<AbortHandle>,
    _listening: OverhearToken,
}

impl Drop for WebPage {
    fn drop(&mut self) {
        self.tasks.iter().for_each(AbortHandle::abort);
    }
}

/// Serves the page of a daemon, if the ecosystem file asks this daemon for one. A daemon that cannot
/// serve the page continues without it and tries again: a page must not keep a building from its
/// work.
pub(crate) fn serve(node: &DaemonNode, ecosystem: &Arc<Ecosystem>) -> Option<WebPage> {
    let settings = ecosystem.web.clone()?;
    let daemon = node.router().daemon().clone();
    if !settings.is_served_by(&daemon) {
        return None;
    }
    let state = match hosting::state_folder(&ecosystem.name, &daemon) {
        Ok(state) => state,
        Err(error) => {
            tracing::error!("no page is served: failed to {error}");
            return None;
        }
    };
    let view = EcosystemView {
        router: Arc::clone(node.router()),
        name: ecosystem.name.clone(),
        ecosystem: Some(Arc::clone(ecosystem)),
        endpoints: Vec::new(),
        keys: None,
    };
    let (inbox, hints) = (Arc::<PageInbox>::default(), Arc::<PollHints>::default());
    let listening = match observing::listen(node, &inbox, &hints) {
        Ok(listening) => listening,
        Err(error) => {
            tracing::error!("no page is served: failed to {error}");
            return None;
        }
    };
    keep_questions(node, ecosystem);
    let page_view = Arc::new(PageView::new(&view));
    let agents = Arc::new(PersonAgents::new(view.clone(), &state));
    let host = DaemonHost::new(view.clone(), Arc::clone(&page_view), Arc::clone(&agents), &state);
    let page = PageOfDaemon { daemon, settings, ecosystem: Arc::clone(ecosystem), state };
    let feed = Arc::clone(&inbox);
    let tasks = [
        tokio::spawn(page_view::feed(inbox, page_view)),
        tokio::spawn(async move {
            observing::follow(&view, ObserverPlace::Daemon, &hints, &feed).await;
        }),
        tokio::spawn(agents.end_idle()),
        tokio::spawn(page.serve(Arc::new(host))),
    ];
    let tasks = tasks.iter().map(JoinHandle::abort_handle).collect();
    Some(WebPage { tasks, _listening: listening })
}

/// Launches a keyboard that keeps the questions of agents until a person answers them on the page,
/// unless the ecosystem file names a keyboard, which does so.
fn keep_questions(node: &DaemonNode, ecosystem: &Ecosystem) {
    let is_keyboard = |entry: &AgentEntry| entry.plugin == keyboard::PLUGIN.name;
    if ecosystem.agents.iter().any(is_keyboard) {
        return;
    }
    let daemon: String = node.router().daemon().as_str().chars().take(DAEMON_CHARS_MAX).collect();
    match AgentId::new(&format!("web-{daemon}")) {
        Ok(id) => node.launch(id, Keyboard::for_questions(), ecosystem.domain.name.as_str()),
        Err(error) => tracing::error!("questions are not kept for the page: {error}"),
    }
}

/// Returns the host and port by which a browser reaches an address: of all addresses of this
/// machine, its name.
fn host_of(at: SocketAddr) -> String {
    match hosting::host_name().filter(|_| at.ip().is_unspecified()) {
        Some(name) => format!("{name}:{}", at.port()),
        None => at.to_string(),
    }
}

/// The page that one daemon serves: its settings and files.
struct PageOfDaemon {
    daemon: DaemonId,
    settings: WebSettings,
    ecosystem: Arc<Ecosystem>,
    state: PathBuf,
}

impl PageOfDaemon {
    /// Opens the socket and serves the page; tries again after a failure. Never returns.
    async fn serve(self, host: Arc<DaemonHost>) {
        let mut said = String::new();
        loop {
            match self.open().await {
                Ok((server, tls, accounts)) => {
                    self.announce(&server, &accounts);
                    host.know_people(Arc::clone(&accounts));
                    let log = self.log();
                    let warned =
                        certificate::warn_of_end(tls, self.daemon.clone(), self.warn_before());
                    let served = server.serve(Arc::<DaemonHost>::clone(&host), accounts, log);
                    tokio::join!(served, warned);
                }
                Err(problem) if problem != said => {
                    tracing::error!("no page is served: failed to {problem}");
                    said = problem;
                }
                Err(_) => (),
            }
            tokio::time::sleep(TRY_AGAIN).await;
        }
    }

    /// Opens the files and the socket. The error text completes the sentence “failed to …”.
    async fn open(&self) -> Result<(PageServer, Option<PageTls>, Arc<Accounts>), String> {
        let accounts = Accounts::open(self.ecosystem.people.clone());
        let accounts = Arc::new(accounts.map_err(|error| error.to_string())?);
        let tls = self.tls()?;
        let (names, words) = (self.settings.names.clone(), self.ecosystem.words.clone());
        let options = PageOptions { names, words, ..PageOptions::default() };
        let server = PageServer::bind(self.settings.listen, tls.clone(), options).await;
        let server = server.map_err(|error| {
            format!(
                "{error}; `listen` in [web] says where, and every daemon of one machine needs an \
                 address of its own: `daemons` says which serve the page"
            )
        })?;
        Ok((server, tls, accounts))
    }

    /// Returns the server's side of TLS; `None` on an address of this machine alone, if the file
    /// names no certificate.
    fn tls(&self) -> Result<Option<PageTls>, String> {
        let Some(files) = certificate::files(&self.ecosystem, &self.daemon)? else {
            return Ok(None);
        };
        let daemon = &self.daemon;
        PageTls::open(files).map(Some).map_err(|error| {
            format!("{error}; `althing cert page {daemon} --host HOST` makes a certificate")
        })
    }

    /// Returns how long before its end the certificate is told.
    fn warn_before(&self) -> Duration {
        let set = self.ecosystem.security.as_ref().map(|security| security.warn_before);
        set.unwrap_or_default().max(certificate::WARN_BEFORE)
    }

    /// Returns the log of requests; `None` if its folder cannot be used.
    fn log(&self) -> Option<Arc<RequestLog>> {
        match RequestLog::open(&self.state) {
            Ok(log) => Some(Arc::new(log)),
            Err(error) => {
                tracing::error!("requests of people are not logged: failed to {error}");
                None
            }
        }
    }

    fn announce(&self, server: &PageServer, accounts: &Accounts) {
        let is_encrypted =
            self.settings.files.is_some() || !self.settings.listen.ip().is_loopback();
        let scheme = if is_encrypted { "https" } else { "http" };
        let at = server.address().unwrap_or(self.settings.listen);
        output::print_note(&format!("page of `{}`: {scheme}://{}/", self.daemon, host_of(at)));
        if accounts.is_empty() {
            tracing::warn!("nobody can sign in at the page yet: `althing people add NAME`");
        }
    }
}

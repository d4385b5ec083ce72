//! A server of pages with a made-up ecosystem, in this process.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::SystemTime;

use accounts::{
    Accounts, PasswordCost, PeopleFile, PersonName, PersonRecord, PersonRight, StoredPassword,
    StoredToken,
};
use tempfile::TempDir;
use tokio::runtime::Runtime;
use tokio::task::JoinHandle;
use web_page::{PageOptions, PageServer};

use crate::chromium::Chromium;
use crate::made_up::MadeUp;

/// The person of the tests, and her password.
pub(crate) const PERSON: &str = "ada";
pub(crate) const PASSWORD: &str = "a password for tests";

/// The name of the screen that tests add.
pub(crate) const SCREEN: &str = "hall-screen";

/// A server of pages.
pub(crate) struct Site {
    pub(crate) host: Arc<MadeUp>,
    pub(crate) people: PeopleFile,
    accounts: Arc<Accounts>,
    address: SocketAddr,
    serving: Option<JoinHandle<()>>,
    runtime: Runtime,
    _folder: TempDir,
}

impl Site {
    /// Serves a made-up ecosystem of so many agents, each with one heartbeat a second.
    pub(crate) fn start(agents: usize) -> Site {
        Site::start_with(agents, PersonRight::ALL.into())
    }

    /// The same, with a person of these rights.
    pub(crate) fn start_with(
        agents: usize,
        rights: std::collections::BTreeSet<PersonRight>,
    ) -> Site {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("people.toml");
        let people = PeopleFile::new(&path);
        let password = StoredPassword::hash(PASSWORD, PasswordCost::FOR_TESTS).expect("a hash");
        let person = PersonRecord {
            name: PersonName::new(PERSON).expect("a name"),
            rights,
            password: Some(password),
            tokens: Vec::new(),
            screen: None,
        };
        people.change(|people| people.add(person)).expect("a new person");
        let accounts = Accounts::open_with(path, PasswordCost::FOR_TESTS).expect("people");
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .expect("a runtime");
        let host = MadeUp::new(agents);
        runtime.spawn(Arc::clone(&host).play(1.0));
        let mut site = Site {
            host,
            people,
            accounts: Arc::new(accounts),
            address: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)),
            serving: None,
            runtime,
            _folder: folder,
        };
        site.serve();
        site
    }

    /// Adds the screen of a robot to the people, and returns the part of an address that makes a
    /// browser this screen.
    pub(crate) fn add_screen(&self, robot: &str) -> String {
        let name = |text| PersonName::new(text).expect("a name");
        let made = StoredToken::make(name("link"), SystemTime::now());
        let (token, stored) = made.expect("random");
        let screen = PersonRecord::screen(name(SCREEN), robot, stored);
        self.people.change(|people| people.add(screen)).expect("a new screen");
        format!("#screen={token}")
    }

    /// Serves, again at the address of before if there was one.
    pub(crate) fn serve(&mut self) {
        let bound = PageServer::bind(self.address, None, PageOptions::default());
        let server = self.runtime.block_on(bound).expect("a free port");
        self.address = server.address().expect("an address");
        let (host, accounts) = (Arc::clone(&self.host), Arc::clone(&self.accounts));
        self.serving = Some(self.runtime.spawn(server.serve(host, accounts, None)));
    }

    /// Ends the server and all its connections, as when its process dies.
    pub(crate) fn die(&mut self) {
        if let Some(serving) = self.serving.take() {
            serving.abort();
            let _ = self.runtime.block_on(serving);
        }
    }

    /// Returns the address of a page.
    pub(crate) fn page(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    /// Opens a page and signs the person in there.
    #[track_caller]
    pub(crate) fn sign_in(&self, browser: &mut Chromium, path: &str) {
        browser.sign_in(&self.page(path), PERSON, PASSWORD);
    }
}

//! Plugins that run as processes (the paper, “Plug & Play”): a folder that is put into another, or
//! taken out, is something that the building can do, or cannot any more, without a restart.
//!
//! - `manifest` and `package` are what a package says of itself; `shelf` is the folder they are in.
//! - `supervision` is the life of one plugin (`lives`: when it is started again; `living`: why it has
//!   to be ended), `process` its process, `confinement` what that may do, `usage` what it takes, `log`
//!   what it prints.
//! - `endpoint` is where it joins: a wire of its own, on which an agent of this house's watches
//!   (`agent::Observer`) and another speaks to it (`attendant`). `proxy` is the same agent as the
//!   ecosystem knows it: an actuator like any other, whose planner and domain this daemon hosts.
//! - `status` is what people see of all that.
//!
//! A plugin says and hears what any actuator does (docs/protocol.md), and only to its host: nothing of
//! it has a meaning in the ecosystem but through the proxy.

mod advice;
mod attendant;
mod cgroup;
mod confinement;
mod endpoint;
mod launching;
mod lives;
mod living;
mod log;
mod looking;
mod manifest;
mod mediator;
mod package;
mod process;
mod program;
mod proxy;
mod rights;
mod shelf;
mod status;
mod supervision;
mod template;
mod trial;
mod usage;
mod wording;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use acl::AgentId;
use acl::content::Discovered;
use agent::{Admission, Admissions, Landing};
use notify::{RecursiveMode, Watcher as _};
use tokio::sync::{Notify, watch};
use tokio::time::Instant;

pub use confinement::{Confinement, ConfinementError, Means, probe};
pub use manifest::{ConfigKey, ConfigShape, Manifest, OwnAgent};
pub use package::{Faults, MANIFEST, Package};
pub use process::Launcher;
pub use rights::{Permissions, Right, listed};
pub use shelf::{Shelf, ShelfError};
pub use status::{Confined, Plugins, State, Status};
pub use supervision::WantedAgent;
pub use trial::{Failed, Trial, Worked};

use launching::Ward;
use log::Log;
use package::{Stamp, stamp};
use supervision::{Statuses, Supervision, Wanted, Wish};

/// What this daemon's own program is told as its first argument, to become a plugin's: a
/// [`Confinement`], the program and its arguments follow.
pub const LAUNCH: &str = "become-plugin";

/// What it is told after that instead, to try out what the kernel has to confine plugins with: a
/// folder follows.
pub const PROBE: &str = "probe";

/// What finds agents here, among all that does.
const PLUGINS: &str = "plugins";

/// How long a folder must be at rest before it is looked at: copies come file by file.
const AT_REST: Duration = Duration::from_millis(60);

/// How often it is looked at for a while after something was done: the kernel tells of files in a new
/// folder only once it was asked to, and those before that it keeps to itself.
const LOOK_SOON: Duration = Duration::from_millis(250);

/// How often it is looked at where the kernel says nothing.
const LOOK_AGAIN: Duration = Duration::from_secs(5);

/// What plugins are hosted with.
pub struct Setting {
    /// Where packages are.
    pub shelf: Shelf,
    /// Where their agents live.
    pub landing: Landing,
    /// The agents that the ecosystem's file gives to this daemon, by package.
    pub agents: BTreeMap<String, Vec<WantedAgent>>,
    /// All agents that the file names, whoever hosts them.
    pub named: BTreeSet<AgentId>,
    /// Which of those that it does not name take part.
    pub admissions: Arc<Admissions>,
    /// This daemon's own program.
    pub launcher: Launcher,
    /// Where sockets are.
    pub sockets: PathBuf,
    /// Where plugins keep what is their own, and where their logs are.
    pub state: PathBuf,
    /// The simulated building's socket.
    pub building: Option<PathBuf>,
    /// Whether plugins run only where nothing of their confinement is missing.
    pub requires_confinement: bool,
    /// Folders of which no plugin reads, whatever it was allowed: keys, sockets, what daemons keep.
    pub private: Vec<PathBuf>,
}

/// What all supervisions stand on.
pub(crate) struct Ground {
    pub(crate) shelf: Shelf,
    pub(crate) landing: Landing,
    pub(crate) launcher: Launcher,
    pub(crate) sockets: PathBuf,
    pub(crate) data: PathBuf,
    pub(crate) building: Option<PathBuf>,
    requires_confinement: bool,
    private: Vec<PathBuf>,
    /// What plugins are confined with; found before the first is started.
    ward: OnceLock<Ward>,
    /// Told when the folder is to be looked at.
    pub(crate) look_again: Notify,
    taken_back: Mutex<BTreeMap<String, String>>,
}

/// What plugins are confined with before that was tried out.
static UNKNOWN: LazyLock<Ward> = LazyLock::new(Ward::unknown);

impl Ground {
    /// What plugins are confined with; nothing, before that is known.
    pub(crate) fn ward(&self) -> &Ward {
        self.ward.get().unwrap_or(&UNKNOWN)
    }

    /// How far plugins are confined here; nothing is said before it is known.
    fn confined(&self) -> Confined {
        let is_required = self.requires_confinement;
        let Some(ward) = self.ward.get() else {
            return Confined { is_required, ..Confined::default() };
        };
        Confined {
            not_enforced: ward.plan(&Permissions::default()).lacks(),
            limits: ward.limits(),
            is_required,
            means: Some(ward.means.clone()),
        }
    }

    /// Which plugins were taken back to the version before, and why.
    pub(crate) fn taken_back(&self) -> MutexGuard<'_, BTreeMap<String, String>> {
        self.taken_back.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Hosts plugins until the daemon drains.
///
/// # Errors
///
/// If a folder of the daemon's own cannot be made.
pub fn host(setting: Setting) -> std::io::Result<()> {
    let Setting { shelf, landing, agents, named, admissions, launcher, sockets, state, .. } =
        setting;
    let Setting { building, requires_confinement, private, .. } = setting;
    for folder in [&sockets, &state] {
        DirBuilder::new().recursive(true).mode(0o700).create(folder)?;
    }
    // A service manager may have put a link there: what is held against the paths of open files and of
    // rights is the place itself.
    let (sockets, state) = (sockets.canonicalize()?, state.canonicalize()?);
    // What is not there yet, links lead to nowhere.
    let real = |folder: PathBuf| folder.canonicalize().unwrap_or(folder);
    let private = private.into_iter().map(real).collect();
    let ground = Arc::new(Ground {
        shelf,
        landing,
        launcher,
        sockets,
        data: state,
        building,
        requires_confinement,
        private,
        ward: OnceLock::new(),
        look_again: Notify::new(),
        taken_back: Mutex::default(),
    });
    let statuses = Statuses::default();
    // Weak: the switchboard is part of the ground.
    let (told_of, told_ground) = (Arc::clone(&statuses), Arc::downgrade(&ground));
    ground.landing.switchboard.tell_plugins(move || {
        told_ground.upgrade().map(|ground| told(&ground, &told_of)).unwrap_or_default()
    });
    let keeper = Keeper {
        ground: Arc::clone(&ground),
        agents,
        named,
        admissions,
        statuses,
        kept: BTreeMap::new(),
    };
    ground.landing.tasks.spawn(keeper.run());
    Ok(())
}

fn told(ground: &Ground, statuses: &Statuses) -> String {
    let plugins = Plugins {
        daemon: ground.landing.switchboard.daemon().clone(),
        folder: ground.shelf.folder.display().to_string(),
        confinement: ground.confined(),
        plugins: statuses
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .values()
            .cloned()
            .collect(),
    };
    serde_json::to_string(&plugins).unwrap_or_default()
}

/// Holds what is in the folder against what runs.
struct Keeper {
    ground: Arc<Ground>,
    agents: BTreeMap<String, Vec<WantedAgent>>,
    named: BTreeSet<AgentId>,
    admissions: Arc<Admissions>,
    statuses: Statuses,
    kept: BTreeMap<String, Kept>,
}

/// One plugin, as it was looked at last.
struct Kept {
    looked: Looked,
    wish: watch::Sender<Wish>,
}

/// All that decides what becomes of a plugin.
#[derive(PartialEq)]
struct Looked {
    stamp: Stamp,
    is_disabled: bool,
    allowed: Vec<Right>,
    admission: Admission,
    /// Why what is in its package may be somebody else's.
    writable: Option<String>,
}

impl Keeper {
    async fn run(mut self) {
        self.find_means().await;
        let touched = Arc::new(Touched::default());
        let _watcher = self.watch(&touched);
        let stopping = self.ground.landing.stopping.clone();
        let mut admitted = self.admissions.changes();
        let mut stirred = Instant::now();
        loop {
            self.look(&touched.take());
            let is_fresh = stirred.elapsed() < LOOK_AGAIN;
            tokio::select! {
                biased;
                () = stopping.cancelled() => return,
                () = self.ground.look_again.notified() => (),
                Ok(()) = admitted.changed() => (),
                () = touched.at_rest() => stirred = Instant::now(),
                () = tokio::time::sleep(if is_fresh { LOOK_SOON } else { LOOK_AGAIN }) => (),
            }
        }
    }

    /// Finds out how plugins are confined here, and says so.
    async fn find_means(&self) {
        let Ground { launcher, data, ward, shelf, private, .. } = &*self.ground;
        let kept = shelf.keep_rights(|name| data.join(name).is_dir());
        if let Err(error) = kept {
            tracing::warn!("failed to {error}");
        }
        let found = Ward::find(launcher, data, private).await;
        let lacks = found.plan(&Permissions::default()).lacks();
        match lacks.is_empty() {
            true => {
                tracing::info!(limits = found.limits(), "plugins are confined, nothing is missing")
            }
            false => tracing::warn!(
                limits = found.limits(),
                "plugins are not fully confined on this machine; of a plugin: {}",
                lacks.join("; ")
            ),
        }
        // Nobody else finds it.
        let _ = ward.set(found);
    }

    /// The kernel says what changes in the folder; where it does not, the folder is looked at now and
    /// then.
    fn watch(&self, touched: &Arc<Touched>) -> Option<notify::RecommendedWatcher> {
        let folder = self.ground.shelf.folder.clone();
        let touched = Arc::clone(touched);
        let heard = {
            let folder = folder.clone();
            move |event: notify::Result<notify::Event>| {
                if let Ok(event) = event {
                    touched.note(&folder, &event);
                }
            }
        };
        let watched = notify::recommended_watcher(heard).and_then(|mut watcher| {
            watcher.watch(&folder, RecursiveMode::Recursive)?;
            Ok(watcher)
        });
        match watched {
            Ok(watcher) => Some(watcher),
            Err(error) => {
                let folder = folder.display();
                tracing::info!(%folder, %error, "the folder of plugins is looked at now and then");
                None
            }
        }
    }

    /// Looks at the folder; `touched` are those about which somebody has said something.
    fn look(&mut self, touched: &BTreeSet<String>) {
        let mut names: BTreeSet<_> = self.ground.shelf.names().into_iter().collect();
        names.extend(self.agents.keys().cloned());
        let gone: Vec<_> =
            self.kept.keys().filter(|name| !names.contains(*name)).cloned().collect();
        for name in gone {
            if let Some(kept) = self.kept.remove(&name) {
                kept.wish.send_replace(Wish::Gone);
            }
        }
        let (mut discovered, mut applicants) = (Vec::new(), BTreeMap::new());
        for name in names {
            let looked = self.looked(&name);
            let package = Package::open(&self.ground.shelf.at(&name));
            if let Some(about) = self.application(&name, package.as_ref().ok(), looked.is_disabled)
            {
                applicants.insert(name.clone(), about);
            }
            let wish = self.wish(&name, package, &looked, &mut discovered);
            match self.kept.get_mut(&name) {
                Some(kept) if kept.looked == looked && !touched.contains(&name) => (),
                Some(kept) => {
                    kept.looked = looked;
                    kept.wish.send_replace(wish);
                }
                None => {
                    let wish = self.begin(&name, wish);
                    self.kept.insert(name, Kept { looked, wish });
                }
            }
        }
        self.admissions.present(PLUGINS, applicants);
        self.ground.landing.switchboard.discovered(PLUGINS, discovered);
    }

    fn looked(&self, name: &str) -> Looked {
        let shelf = &self.ground.shelf;
        let writers = shelf.check_writers().and_then(|()| shelf.check_writers_of(name));
        Looked {
            stamp: stamp(&shelf.at(name)),
            is_disabled: shelf.is_disabled(name),
            allowed: shelf.allowed(name),
            admission: self.admissions.of(PLUGINS, name),
            writable: writers.err().map(|error| error.to_string()),
        }
    }

    /// What a person is told of a package that wants to take part and that nobody has let in.
    fn application(
        &self,
        name: &str,
        package: Option<&Package>,
        is_disabled: bool,
    ) -> Option<String> {
        let manifest = &package?.manifest;
        let is_asked = self.admissions.of(PLUGINS, name) == Admission::Asked;
        if is_disabled || !is_asked || self.agents.contains_key(name) {
            return None;
        }
        let own: Vec<_> = manifest.agents.iter().map(|own| own.name.as_str()).collect();
        if own.is_empty() && manifest.brings.is_empty() {
            return None;
        }
        let brings = if own.is_empty() { "agents of its own".to_owned() } else { own.join(", ") };
        Some(format!("a plugin, with {brings}"))
    }

    fn wish(
        &self,
        name: &str,
        package: Result<Package, Faults>,
        looked: &Looked,
        discovered: &mut Vec<Discovered>,
    ) -> Wish {
        let named = self.agents.get(name);
        let package = match package {
            Ok(package) => package,
            Err(faults) if self.ground.shelf.at(name).exists() => {
                return Wish::Rest(State::Invalid, Some(faults.first()), None);
            }
            Err(_) => {
                let folder = self.ground.shelf.folder.display();
                let reason = format!("the ecosystem's file names it, and it is not in {folder}");
                return Wish::Rest(State::Invalid, Some(reason), None);
            }
        };
        let Looked { admission, is_disabled, .. } = looked;
        let joined = named.is_none() && *admission == Admission::Granted && !is_disabled;
        let own = || package.manifest.agents.iter().filter(|own| !self.named.contains(&own.name));
        if named.is_none() {
            discovered.extend(own().map(|own| Discovered {
                agent: own.name.clone(),
                by: format!("plugin {name}"),
                joined,
                problem: admission.reason(),
                toml: entry(name, own),
            }));
        }
        if *is_disabled {
            return Wish::Rest(State::Disabled, None, Some(Arc::new(package)));
        }
        let agents: Vec<_> = match named {
            Some(named) => named.clone(),
            None if joined => own()
                .map(|own| WantedAgent {
                    name: own.name.clone(),
                    plugin: name.to_owned(),
                    driver: own.driver.clone(),
                    config: own.config.clone(),
                })
                .collect(),
            None => Vec::new(),
        };
        let brings = joined && !package.manifest.brings.is_empty();
        if agents.is_empty() && !brings {
            let has_agents =
                !package.manifest.agents.is_empty() || !package.manifest.brings.is_empty();
            let reason = match admission {
                Admission::Listed if has_agents => {
                    "its agents are listed and do not join: `admit = \"listed\"`".to_owned()
                }
                Admission::Asked | Admission::Denied if has_agents => {
                    admission.reason().unwrap_or_default()
                }
                _ => "no [[agent]] of the ecosystem's file names it, and it brings none".to_owned(),
            };
            return Wish::Rest(State::Unused, Some(reason), Some(Arc::new(package)));
        }
        match self.refusal(&package, looked) {
            Some((state, why)) => Wish::Rest(state, Some(why), Some(Arc::new(package))),
            None => Wish::Run(Arc::new(Wanted { package: Arc::new(package), agents })),
        }
    }

    /// Why a package must not run, although its agents are wanted.
    fn refusal(&self, package: &Package, looked: &Looked) -> Option<(State, String)> {
        let Ground { requires_confinement, .. } = &*self.ground;
        let (name, permissions) = (&package.manifest.name, &package.manifest.permissions);
        if let Some(problem) = &looked.writable {
            return Some((State::Invalid, format!("failed to {problem}")));
        }
        let beyond = permissions.beyond(&looked.allowed);
        if !beyond.is_empty() {
            let asks = listed(&beyond);
            let why = format!(
                "it asks for {asks}, and nobody has allowed that: althing plugin allow {name}"
            );
            return Some((State::NotAllowed, why));
        }
        let lacks = self.ground.ward().plan(permissions).lacks();
        let why = trial::not_confined(*requires_confinement, &lacks);
        why.map(|why| (State::NotConfined, why))
    }

    fn begin(&self, name: &str, wish: Wish) -> watch::Sender<Wish> {
        let (wish, wishes) = watch::channel(wish);
        let path = self.ground.data.join(format!("{name}.log"));
        let supervision = Supervision {
            name: name.to_owned(),
            ground: Arc::clone(&self.ground),
            wishes,
            statuses: Arc::clone(&self.statuses),
            log: Log::new(name, path),
        };
        self.ground.landing.tasks.spawn(supervision.run());
        wish
    }
}

/// The lines that would configure an agent of a package.
fn entry(package: &str, own: &OwnAgent) -> String {
    let mut text = format!("[[agent]]\nname = \"{}\"\npackage = \"{package}\"\n", own.name);
    if let Some(driver) = &own.driver {
        text += &format!("driver = \"{driver}\"\n");
    }
    if let Ok(config) = toml::to_string(&own.config)
        && !config.trim().is_empty()
    {
        text += &format!("\n[agent.config]\n{config}");
    }
    text
}

/// Which plugins something was done to in the folder.
#[derive(Default)]
struct Touched {
    names: Mutex<BTreeSet<String>>,
    something: Notify,
}

impl Touched {
    fn note(&self, folder: &std::path::Path, event: &notify::Event) {
        if event.kind.is_access() {
            return;
        }
        for path in &event.paths {
            let within = path.strip_prefix(folder).ok();
            let first = within.and_then(|within| within.components().next());
            let Some(name) = first.and_then(|first| first.as_os_str().to_str()) else { continue };
            // `.NAME.disabled` and `.NAME.rights` are about NAME; what is in a package is seen by its
            // files.
            if let Some((name, "disabled" | "rights")) =
                name.strip_prefix('.').and_then(|name| name.rsplit_once('.'))
            {
                self.lock().insert(name.to_owned());
            }
        }
        self.something.notify_one();
    }

    fn lock(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.names.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take(&self) -> BTreeSet<String> {
        std::mem::take(&mut *self.lock())
    }

    /// Waits until something was done, and nothing more for a moment.
    async fn at_rest(&self) {
        self.something.notified().await;
        while tokio::time::timeout(AT_REST, self.something.notified()).await.is_ok() {}
    }
}

//! A building that the test's process simulates, the daemons in it, and the page that one of them
//! serves. The truth of the building is the test's own, and no daemon can change it but by devices.

use std::fmt::Write as _;
use std::time::Duration;

use building::{Building, BuildingDevice, Layout, Server, Truth};
use tokio::runtime::Runtime;

use crate::chromium::Chromium;
use crate::support::page_client::{PASSWORD, PageAddress, add_person, free_port};
use crate::support::{Office, PATIENCE};

/// The person that watches the page, and asks there.
pub(super) const PERSON: &str = "ada";

/// The daemon of the reasoning agents, which serves the page.
pub(super) const REASONING: &str = "reasoning";

/// Number of times that a condition of the page is waited for, each as long as the browser waits. A
/// scenario takes longer than that on a machine that is busy with other tests.
const WAITS: u32 = 4;

/// What a test plays in: the building, and which daemon hosts which device.
pub(super) struct PageScene<'a> {
    /// The building with all its devices, also those that come later.
    pub(super) layout: Layout,
    /// The building as it is at first.
    pub(super) at_first: Layout,
    /// The devices that have a daemon of their own, named as the device.
    pub(super) apart: &'a [&'a str],
    /// Further keys of the `config` of a device's agent.
    pub(super) more: &'a dyn Fn(&BuildingDevice) -> String,
    /// Seconds that a second of the building takes.
    pub(super) pace: f64,
}

/// A running ecosystem with a page.
pub(super) struct PageStage {
    pub(super) office: Office,
    pub(super) building: Building,
    pub(super) page: PageAddress,
    pub(super) runtime: Runtime,
    _server: Server,
}

impl<'a> PageScene<'a> {
    /// Returns a scene in which no device comes later, and one daemon hosts everything.
    pub(super) fn of(layout: &Layout) -> PageScene<'a> {
        let (layout, at_first) = (layout.clone(), layout.clone());
        PageScene { layout, at_first, apart: &[], more: &|_| String::new(), pace: 0.02 }
    }

    fn file(&self, port: u16) -> String {
        let office = Office::file().canonicalize().expect("it is there");
        let domain = office.ancestors().nth(2).expect("a folder").join("domains/smart-office");
        let mut text = format!(
            "[ecosystem]\nname = \"smart-office\"\ndomain = \"{}/domain.pddl\"\n\
             problem = \"map.pddl\"\n\n[web]\nlisten = \"127.0.0.1:{port}\"\n\
             daemons = [\"{REASONING}\"]\n\n[building]\ntime-scale = {}\n\n",
            domain.display(),
            self.pace
        );
        for plugin in ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"] {
            entry(&mut text, plugin, plugin, REASONING, "");
        }
        for device in self.layout.devices() {
            let Some((plugin, config)) = agent_of(device, &self.layout) else { continue };
            let name = device.name();
            let daemon = if self.apart.contains(&name) { name } else { REASONING };
            entry(&mut text, name, plugin, daemon, &(config + &(self.more)(device)));
        }
        text
    }
}

fn entry(text: &mut String, name: &str, plugin: &str, daemon: &str, config: &str) {
    let _ = write!(
        text,
        "[[agent]]\nname = \"{name}\"\nplugin = \"{plugin}\"\ndaemon = \"{daemon}\"\n\
         config = {{ {config} }}\n\n"
    );
}

/// Returns the plugin of a device's agent, and where the device is; `None` if it has no agent.
fn agent_of(device: &BuildingDevice, layout: &Layout) -> Option<(&'static str, String)> {
    let at = |location: &String| format!("location = \"{location}\"");
    let has_screen = |robot: &String| {
        layout.devices().iter().any(
            |device| matches!(device, BuildingDevice::MountedScreen { carrier, .. } if carrier == robot),
        )
    };
    Some(match device {
        BuildingDevice::FixedSensor { location, .. } => ("temperature-sensor", at(location)),
        BuildingDevice::Sensor { location, quantity, .. } => {
            ("sensor", format!("quantity = \"{}\", {}", quantity.name(), at(location)))
        }
        BuildingDevice::Camera { location, .. } => ("ptz-camera", at(location)),
        BuildingDevice::Screen { location, .. } => ("screen", at(location)),
        BuildingDevice::MountedSensor { carrier, .. } => {
            ("ir-temperature-sensor", format!("mounted-on = \"{carrier}\""))
        }
        BuildingDevice::Robot { name, start, meters_per_second } => {
            let plugin = if has_screen(name) { "video-robot" } else { "turtlebot" };
            (plugin, format!("start = \"{start}\", speed = {meters_per_second:?}"))
        }
        _ => return None,
    })
}

impl PageStage {
    /// Starts the daemons that are there at first.
    pub(super) fn open(scene: &PageScene<'_>) -> PageStage {
        let (runtime, office, port) =
            (Runtime::new().expect("a runtime"), Office::new(), free_port());
        office.write("map.pddl", &scene.layout.map_pddl("smart-office"));
        let file = office.write("althing.toml", &scene.file(port));
        let mut office = office.with_file(file);
        let building = Building::new(scene.at_first.clone(), scene.pace).expect("a building");
        let serving = building::serve(building.handle(), office.folder().join("building.sock"));
        let _server = runtime.block_on(serving).expect("a socket");
        add_person(&office, PERSON, &["--role", "operator"]);
        office.up(&[REASONING], &[]);
        let is_there = |name: &&&str| scene.at_first.device(name).is_some();
        let apart: Vec<&str> = scene.apart.iter().filter(is_there).copied().collect();
        office.up(&apart, &[]);
        let page = PageAddress::plain(port);
        page.await_page();
        PageStage { office, building, page, runtime, _server }
    }

    /// Opens a page and signs the person in there.
    #[track_caller]
    pub(super) fn sign_in(&self, browser: &mut Chromium, path: &str) {
        browser.sign_in(&self.page.url(path), PERSON, PASSWORD);
    }

    /// Waits until the page shows that these agents are present.
    #[track_caller]
    pub(super) fn await_agents(&self, browser: &mut Chromium, names: &[&str]) {
        browser.open(&self.page.url("/agents"));
        for name in names {
            wait_long(browser, &is_in_row(name, "present"));
        }
    }

    /// Asks for a goal that is typed, and goes to the page of the goal.
    #[track_caller]
    pub(super) fn ask_for(&self, browser: &mut Chromium, goal: &str, is_kept: bool) {
        ask_for(&self.page, browser, goal, is_kept);
    }

    /// Waits until the truth of the building is as wanted.
    #[track_caller]
    pub(super) fn until(&self, is_so: impl FnMut(&Truth) -> bool) -> Truth {
        self.within(PATIENCE, self.building.wait_for(is_so))
    }

    #[track_caller]
    pub(super) fn within<T>(&self, limit: Duration, wait: impl Future<Output = T>) -> T {
        let waited = self.runtime.block_on(async { tokio::time::timeout(limit, wait).await });
        waited.expect("the building has seen it in time")
    }
}

/// Asks for a goal that is typed, and goes to the page of the goal.
#[track_caller]
pub(super) fn ask_for(page: &PageAddress, browser: &mut Chromium, goal: &str, is_kept: bool) {
    browser.open(&page.url("/ask"));
    browser.click(".builder button", "Type the PDDL yourself");
    browser.wait_for("!document.querySelector('.pddl textarea').readOnly");
    browser.evaluate(
        "(() => { const area = document.querySelector('.pddl textarea'); area.focus(); area.select(); })()",
    );
    browser.type_text(goal);
    if is_kept {
        browser.click(".choice", "Keep it so");
    }
    browser.click("button", "Ask for it");
    browser.click(".outcome a", "Show the goal");
    browser.wait_for("location.pathname.startsWith('/goals/') && document.querySelector('.lead')");
}

/// Returns the condition that a row of the page's table begins with a name, or with the words of a
/// goal or fact, and has a state.
pub(super) fn is_in_row(name: &str, state: &str) -> String {
    format!(
        "[...document.querySelectorAll('.table-body .table-row')].some((row) => [row.querySelector('.cell-main').innerText, row.querySelector('.cell-main bdi[title]')?.title].includes({name:?}) && row.querySelector('.state').innerText.includes({state:?}))"
    )
}

/// Returns the condition that the page of a goal shows this state.
pub(super) fn goal_is(state: &str) -> String {
    format!("document.querySelector('.lead .state').innerText.includes({state:?})")
}

/// Returns the condition that a plan on the page of a goal has a step with these words.
pub(super) fn has_step(words: &[&str]) -> String {
    let words = words.iter().map(|word| format!("step.innerText.includes({word:?})"));
    let words = words.collect::<Vec<_>>().join(" && ");
    format!("[...document.querySelectorAll('.gantt-text')].some((step) => {words})")
}

/// Waits for a condition of the page as long as the daemons may take.
#[track_caller]
pub(super) fn wait_long(browser: &mut Chromium, condition: &str) {
    for _ in 1..WAITS {
        if browser.holds_soon(condition) {
            return;
        }
    }
    browser.wait_for(condition);
}

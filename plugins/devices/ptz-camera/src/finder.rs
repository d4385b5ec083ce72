//! The camera finder: lists the ONVIF cameras of the network (WS-Discovery). With each it lists the
//! lines of the ecosystem file that make the camera an agent.
//!
//! A found camera takes part only by those lines, because only people know its login and the places
//! that it shows.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use acl::AgentId;
use agent::discovery::FoundDevice;
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, DiscoveredAgents, DiscoversAgents,
    LaunchableAgent, PluginEntry, WorkHandle, discovery,
};
use onvif_link::{FoundCamera, WS_DISCOVERY, discover};
use serde::Deserialize;

/// The entry of the camera finder in the daemon's table of plugins.
pub const FINDER: PluginEntry = PluginEntry {
    name: "camera-finder",
    about: "lists the ONVIF cameras of the network, with the lines that bring them in",
    drivers: &[],
    has_replicas: false,
    build,
};

/// Time for which answers are awaited. Devices answer after a random pause of at most half a
/// second, and the question is asked twice.
const LISTENING_TIME: Duration = Duration::from_secs(3);

/// Pause between two searches. A camera that is plugged in needs about as long to start.
const SEARCH_INTERVAL: Duration = Duration::from_secs(30);

/// Port of WS-Discovery, for a device that is asked alone.
const PORT: u16 = 3702;

/// Maximum length of the part of a camera's name that is used in the name of its agent.
const NAME_MAX: usize = 48;

/// Maximum number of cameras that are listed.
const CAMERAS_MAX: usize = 256;

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct FinderConfig {
    /// Device that is asked alone, where the network does not carry the question to all:
    /// `IP` or `IP:PORT`.
    ask: Option<String>,
    /// Cameras that are not listed, by their addresses, for example because they have an entry.
    #[serde(default)]
    ignore: Vec<String>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let config: FinderConfig = blueprint.config_as()?;
    let to = match &config.ask {
        None => WS_DISCOVERY,
        Some(text) => {
            let alone = || text.parse::<IpAddr>().ok().map(|ip| SocketAddr::new(ip, PORT));
            let to = text.parse::<SocketAddr>().ok().or_else(alone);
            to.ok_or_else(|| blueprint.problem(format!("ask `{text}`: write IP or IP:PORT")))?
        }
    };
    Ok(Box::new(CameraFinder {
        daemon_note: format!("found by `{}`", blueprint.id),
        discovered: DiscoveredAgents::new(&blueprint.host, CAMERAS_MAX),
        config,
        to,
        found: Vec::new(),
        problem: None,
        search: None,
    }))
}

struct CameraFinder {
    daemon_note: String,
    config: FinderConfig,
    to: SocketAddr,
    discovered: DiscoveredAgents<()>,
    found: Vec<FoundCamera>,
    problem: Option<String>,
    search: Option<WorkHandle>,
}

impl Agent for CameraFinder {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        discovery::follow_admissions(self, ctx);
        self.start_search(ctx);
    }
}

impl DiscoversAgents for CameraFinder {
    type Part = ();

    fn discovered_agents(&mut self) -> &mut DiscoveredAgents<()> {
        &mut self.discovered
    }

    fn found_devices(&self) -> Vec<FoundDevice<()>> {
        let is_wanted = |camera: &&FoundCamera| !self.config.ignore.contains(&camera.address);
        let found = self.found.iter().filter(is_wanted);
        found.filter_map(|camera| self.finding(camera)).collect()
    }

    fn discovery_problem(&self) -> Option<String> {
        self.problem.clone()
    }

    fn build(&self, agent: &AgentId, _part: &()) -> Result<Box<dyn LaunchableAgent>, BuildError> {
        let problem = "a found camera takes part by an entry in the ecosystem file".to_owned();
        Err(BuildError::Other { agent: agent.clone(), problem })
    }
}

impl CameraFinder {
    fn start_search(&mut self, ctx: &mut Context<Self>) {
        let searching = discover(self.to, LISTENING_TIME);
        let work = ctx.run(searching, |finder: &mut Self, found, ctx| {
            match found {
                Ok(found) => (finder.found, finder.problem) = (found, None),
                Err(problem) => finder.problem = Some(format!("failed to {problem}")),
            }
            discovery::schedule_reconcile(finder, ctx);
            ctx.after(SEARCH_INTERVAL, |finder: &mut Self, ctx| finder.start_search(ctx));
        });
        self.search = Some(work);
    }

    fn finding(&self, camera: &FoundCamera) -> Option<FoundDevice<()>> {
        let agent = AgentId::new(&name_of(camera)).ok()?;
        let toml = lines(&agent, camera, &self.daemon_note);
        let reason = "its login and its presets are not known";
        Some(FoundDevice {
            agent,
            is_named: false,
            room: None,
            part: Err(reason.to_owned()),
            problem: None,
            toml,
        })
    }
}

/// Returns the lines of the ecosystem file by which a camera takes part.
fn lines(agent: &AgentId, camera: &FoundCamera, note: &str) -> String {
    let FoundCamera { name, hardware, can_turn, address, .. } = camera;
    let turns = if *can_turn { ", turns" } else { "" };
    format!(
        "# {} {}{turns}; {note}. Store a preset in the camera for each place.\n\
         [[agent]]\nname = \"{agent}\"\nplugin = \"ptz-camera\"\ndriver = \"onvif\"\n\n\
         [agent.config]\nlocation = \"PLACE\"\naddress = {}\nuser = \"USER\"\n\
         password-file = \"/etc/althing/{agent}.password\"\n\
         presets.PLACE = {{ shows = \"PLACE\", preset = \"NAME IN THE CAMERA\" }}\n",
        plain(name),
        plain(hardware),
        quoted(address)
    )
}

/// Returns a text of a camera for a comment, without characters that could end the line.
fn plain(text: &str) -> String {
    text.chars().filter(|symbol| !symbol.is_control()).collect()
}

/// Returns a text of a camera as a string of TOML.
fn quoted(text: &str) -> String {
    format!("\"{}\"", plain(text).replace('\\', "\\\\").replace('"', "\\\""))
}

/// Returns the name of a camera's agent: the name of the camera, or else its address.
fn name_of(camera: &FoundCamera) -> String {
    let named = if camera.name.is_empty() { &camera.address } else { &camera.name };
    let plain = |symbol: char| if symbol.is_ascii_alphanumeric() { symbol } else { '-' };
    let name: String = named.to_ascii_lowercase().chars().map(plain).take(NAME_MAX).collect();
    let name = name.trim_matches('-');
    match name.strip_prefix("camera").unwrap_or(name).trim_start_matches('-') {
        "" => "camera".to_owned(),
        rest => format!("camera-{rest}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lines_of_a_camera_are_toml_whatever_it_is_called() {
        for (name, expected) in [
            ("Hall Camera", "camera-hall-camera"),
            ("", "camera-10-0-0-9"),
            ("Camera 1", "camera-1"),
            ("\"]\n[evil]\nx=\"", "camera-evil--x"),
            (&"ä".repeat(99), "camera"),
        ] {
            let camera = FoundCamera {
                id: "urn:uuid:1".to_owned(),
                name: name.to_owned(),
                hardware: "IPC\n[x]".to_owned(),
                can_turn: true,
                address: "10.0.0.9".to_owned(),
            };
            let agent = AgentId::new(&name_of(&camera)).expect("a name");
            assert_eq!(agent.as_str(), expected);
            let lines = lines(&agent, &camera, "found by `finder`");
            assert_eq!(lines.matches("\n[").count(), 2, "{lines}");
            assert!(lines.contains("address = \"10.0.0.9\"\n"), "{lines}");
        }
    }
}

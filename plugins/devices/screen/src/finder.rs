//! The screen finder: lists the Chromecasts of the network (multicast DNS). With each it lists the
//! lines of the ecosystem file that make the Chromecast an agent.
//!
//! A found Chromecast takes part only by those lines, because only people know its room and what it
//! has to show.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use acl::AgentId;
use agent::discovery::FoundDevice;
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, DiscoveredAgents, DiscoversAgents,
    LaunchableAgent, PluginEntry, WorkHandle, discovery,
};
use cast_link::{FoundCast, MULTICAST_DNS, discover};
use serde::Deserialize;

/// The entry of the screen finder in the daemon's table of plugins.
pub const FINDER: PluginEntry = PluginEntry {
    name: "screen-finder",
    about: "lists the Chromecasts of the network, with the lines that bring them in",
    drivers: &[],
    has_replicas: false,
    build,
};

/// Time for which answers are awaited. Devices on Wi-Fi may miss the first of the questions, which
/// are sent after 0, 1 and 3 s.
const LISTENING_TIME: Duration = Duration::from_secs(5);

/// Pause between two searches. A device that is plugged in needs about as long to start.
const SEARCH_INTERVAL: Duration = Duration::from_secs(30);

/// Maximum length of the part of a device's name that is used in the name of its agent.
const NAME_MAX: usize = 48;

/// Maximum number of devices that are listed.
const DEVICES_MAX: usize = 256;

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct ScreenFinderConfig {
    /// Device that is asked alone, where the network does not carry the question to all:
    /// `IP` or `IP:PORT`.
    ask: Option<String>,
    /// Devices that are not listed, by their addresses, for example because they have an entry.
    #[serde(default)]
    ignore: Vec<String>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let config: ScreenFinderConfig = blueprint.config_as()?;
    let to = match &config.ask {
        None => MULTICAST_DNS,
        Some(text) => {
            let port = MULTICAST_DNS.port();
            let alone = || text.parse::<IpAddr>().ok().map(|ip| SocketAddr::new(ip, port));
            let to = text.parse::<SocketAddr>().ok().or_else(alone);
            to.ok_or_else(|| blueprint.problem(format!("ask `{text}`: write IP or IP:PORT")))?
        }
    };
    Ok(Box::new(ScreenFinder {
        daemon_note: format!("found by `{}`", blueprint.id),
        discovered: DiscoveredAgents::new(&blueprint.host, DEVICES_MAX),
        config,
        to,
        found: Vec::new(),
        problem: None,
        search: None,
    }))
}

struct ScreenFinder {
    daemon_note: String,
    config: ScreenFinderConfig,
    to: SocketAddr,
    discovered: DiscoveredAgents<()>,
    found: Vec<FoundCast>,
    problem: Option<String>,
    search: Option<WorkHandle>,
}

impl Agent for ScreenFinder {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        discovery::follow_admissions(self, ctx);
        self.start_search(ctx);
    }
}

impl DiscoversAgents for ScreenFinder {
    type Part = ();

    fn discovered_agents(&mut self) -> &mut DiscoveredAgents<()> {
        &mut self.discovered
    }

    fn found_devices(&self) -> Vec<FoundDevice<()>> {
        let is_wanted = |device: &&FoundCast| !self.config.ignore.contains(&device.address);
        let found = self.found.iter().filter(is_wanted);
        found.filter_map(|device| self.finding(device)).collect()
    }

    fn discovery_problem(&self) -> Option<String> {
        self.problem.clone()
    }

    fn build(&self, agent: &AgentId, _part: &()) -> Result<Box<dyn LaunchableAgent>, BuildError> {
        let problem = "a found screen takes part by an entry in the ecosystem file".to_owned();
        Err(BuildError::Other { agent: agent.clone(), problem })
    }
}

impl ScreenFinder {
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

    fn finding(&self, device: &FoundCast) -> Option<FoundDevice<()>> {
        let agent = AgentId::new(&name_of(device)).ok()?;
        let toml = lines(&agent, device, &self.daemon_note);
        let reason = "its room and its media are not known";
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

/// Returns the lines of the ecosystem file by which a Chromecast takes part.
fn lines(agent: &AgentId, device: &FoundCast, note: &str) -> String {
    let FoundCast { name, model, address, .. } = device;
    format!(
        "# {}, {}; {note}. It fetches its media by itself, from addresses that it reaches.\n\
         [[agent]]\nname = \"{agent}\"\nplugin = \"screen\"\ndriver = \"cast\"\n\n\
         [agent.config]\nlocation = \"ROOM\"\naddress = {}\n\
         media.NAME = \"http://SERVER/FILM.mp4\"\n",
        plain(name),
        plain(model),
        quoted(address)
    )
}

/// Returns a text of a device for a comment, without characters that could end the line.
fn plain(text: &str) -> String {
    text.chars().filter(|symbol| !symbol.is_control()).collect()
}

/// Returns a text of a device as a string of TOML.
fn quoted(text: &str) -> String {
    format!("\"{}\"", plain(text).replace('\\', "\\\\").replace('"', "\\\""))
}

/// Returns the name of a device's agent: the name of the device, or else its address.
fn name_of(device: &FoundCast) -> String {
    let named = if device.name.is_empty() { &device.address } else { &device.name };
    let plain = |symbol: char| if symbol.is_ascii_alphanumeric() { symbol } else { '-' };
    let name: String = named.to_ascii_lowercase().chars().map(plain).take(NAME_MAX).collect();
    let name = name.trim_matches('-');
    match name.strip_prefix("screen").unwrap_or(name).trim_start_matches('-') {
        "" => "screen".to_owned(),
        rest => format!("screen-{rest}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lines_of_a_chromecast_are_toml_whatever_it_is_called() {
        for (name, expected) in [
            ("Living Room TV", "screen-living-room-tv"),
            ("", "screen-10-0-0-7"),
            ("Screen 1", "screen-1"),
            ("\"]\n[evil]\nx=\"", "screen-evil--x"),
            (&"ä".repeat(99), "screen"),
        ] {
            let device = FoundCast {
                id: "6c1f".to_owned(),
                name: name.to_owned(),
                model: "Chromecast\n[x]".to_owned(),
                address: "10.0.0.7".to_owned(),
            };
            let agent = AgentId::new(&name_of(&device)).expect("a name");
            assert_eq!(agent.as_str(), expected);
            let lines = lines(&agent, &device, "found by `finder`");
            assert_eq!(lines.matches("\n[").count(), 2, "{lines}");
            assert!(lines.contains("address = \"10.0.0.7\"\n"), "{lines}");
        }
    }
}

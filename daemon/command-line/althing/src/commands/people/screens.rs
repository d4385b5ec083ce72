//! Adds the screen on board of a robot: a name without rights, and a link with its token.

use std::process::ExitCode;
use std::time::SystemTime;

use accounts::{PersonName, PersonRecord, StoredToken};
use acl::AgentId;
use serde_json::json;
use terminal::{exit, output};

use super::{COPY, PeopleFailure, PeoplePlace, person_name};
use crate::cli::people::PeopleScreenArgs;
use crate::config::Ecosystem;

/// The name of the only token of a screen.
const TOKEN: &str = "link";

/// Adds a screen, and prints its link.
pub(super) fn add(args: &PeopleScreenArgs) -> Result<ExitCode, PeopleFailure> {
    let place = PeoplePlace::find(&args.place)?;
    let robot = robot(&place.ecosystem, &args.robot)?;
    let origin = origin(&place.ecosystem).ok_or_else(|| {
        let problem = "no daemon of this ecosystem serves a page: `[web]` in its file asks for one";
        PeopleFailure::Wrong(problem.to_owned())
    })?;
    let name = screen_name(args, &robot)?;
    place.check_is_no_agent(&name)?;
    let (token, stored) = StoredToken::make(person_name(TOKEN)?, SystemTime::now())?;
    let link = format!("{origin}/robot/{robot}#screen={token}");
    let record = PersonRecord::screen(name.clone(), robot.as_str(), stored);
    place.file.change(|people| people.add(record))?;
    if args.print.json {
        let file = place.file.path();
        let value = json!({
            "status": "ok", "file": file, "name": name, "screen": robot, "link": link,
        });
        return Ok(output::print_json(&value, exit::DONE));
    }
    let text = format!(
        "added `{name}`, the screen of `{robot}`, to {}\n\
         link: {link}\n\
         It is not shown again, and is a key: whoever opens it sees `{robot}`, answers its questions\n\
         and stops it. Open it once in the browser of the robot, which keeps it in a cookie; from\n\
         then on the address without `#screen=…` is enough. `althing people remove {name}` ends it.\n\
         {COPY}\n",
        place.file.path().display()
    );
    Ok(output::print(text, exit::DONE))
}

/// Returns the agent of the ecosystem file that is called `name`.
fn robot(ecosystem: &Ecosystem, name: &str) -> Result<AgentId, PeopleFailure> {
    let mut agents = ecosystem.agents.iter().map(|entry| &entry.name);
    if let Some(found) = agents.find(|agent| agent.as_str() == name) {
        return Ok(found.clone());
    }
    let names = ecosystem.agents.iter().map(|entry| entry.name.as_str());
    let near = pddl::nearest(name, names);
    let near = near.map(|near| format!("; did you mean `{near}`?")).unwrap_or_default();
    Err(PeopleFailure::Wrong(format!("the ecosystem file names no agent `{name}`{near}")))
}

/// Returns the name of the screen: the one that was given, or one after the robot.
fn screen_name(args: &PeopleScreenArgs, robot: &AgentId) -> Result<PersonName, PeopleFailure> {
    if let Some(name) = &args.name {
        return person_name(name);
    }
    let name = format!("{robot}-screen");
    PersonName::new(&name).map_err(|_| {
        let problem = format!("`{name}` is too long for a name; give the screen one with --name");
        PeopleFailure::Wrong(problem)
    })
}

/// Returns the beginning of the addresses of the page, as a browser on the machine of the daemon
/// opens it, or on another one if other machines reach it; `None` if no daemon serves a page.
fn origin(ecosystem: &Ecosystem) -> Option<String> {
    let web = ecosystem.web.as_ref()?;
    let is_encrypted = web.files.is_some() || !web.listen.ip().is_loopback();
    let scheme = if is_encrypted { "https" } else { "http" };
    if !web.listen.ip().is_unspecified() {
        return Some(format!("{scheme}://{}", web.listen));
    }
    let daemon = web.daemons.first().map(|daemon| daemon.as_str());
    let host = web.names.first().map(String::as_str).or(daemon).unwrap_or("localhost");
    Some(format!("{scheme}://{host}:{}", web.listen.port()))
}

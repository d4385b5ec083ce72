//! `althing robot`: prints the pose in which a robot stands now, as the pose of a place.

use std::process::ExitCode;

use terminal::{exit, output};

use crate::cli::robot::RobotArgs;
use crate::config::{self, Ecosystem, Overrides};
use crate::plugins;

/// Runs `althing robot`: prints the line of `config.ros2.places` with the place and the robot's
/// pose.
pub(super) fn run(args: &RobotArgs) -> ExitCode {
    let failed = |problem: &str| {
        output::print_note(&format!("error: failed to {problem}"));
        exit::with(exit::BAD_INPUT)
    };
    let file = match &args.ecosystem {
        Some(asked) => match config::resolve_ecosystem(&asked.to_string_lossy()) {
            Ok(file) => file,
            Err(problem) => return failed(&problem),
        },
        None => match config::find_ecosystem_file() {
            Some(file) => file,
            None => return failed("find an ecosystem file here; name one with --ecosystem"),
        },
    };
    let ecosystem = match Ecosystem::load(&file, &Overrides::default(), &plugins::known()) {
        Ok(ecosystem) => ecosystem,
        Err(error) => {
            output::show_to_person(&error.into_report());
            return exit::with(exit::BAD_INPUT);
        }
    };
    let RobotArgs { agent, place, .. } = args;
    let entry = ecosystem.agents.iter().find(|entry| entry.name.as_str() == agent);
    let Some(entry) = entry.filter(|entry| entry.driver.as_deref() == Some("ros2")) else {
        let robots = ecosystem.agents.iter().filter(|it| it.driver.as_deref() == Some("ros2"));
        let robots: Vec<_> = robots.map(|entry| format!("`{}`", entry.name)).collect();
        let known = if robots.is_empty() { "none".to_owned() } else { robots.join(", ") };
        return failed(&format!(
            "find a robot `{agent}` with `driver = \"ros2\"` in {}; there is {known}",
            file.display()
        ));
    };
    super::in_runtime(async {
        match mobile_base::recorded_pose(&entry.config).await {
            Ok(pose) => output::print(format!("{place} = {pose}\n"), exit::DONE),
            Err(problem) => {
                output::print_note(&format!("error: failed to {problem}"));
                exit::with(exit::UNAVAILABLE)
            }
        }
    })
}

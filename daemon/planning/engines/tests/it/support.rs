//! Functions that the tests share: parsing, and finding installed engines. A missing engine is
//! reported.

#[path = "../../../../../tests/support/left_out.rs"]
mod left_out;

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use engines::{EngineError, EngineOptions, EngineOutcome, ExternalEngine, Installation, plan};
use pddl::{Domain, Problem};
use planner::Cancel;

/// Time limit of an engine's run in a test, sufficient on a machine that is busy with other tests.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

#[track_caller]
pub(crate) fn parse(domain: &str, problem: &str) -> (Domain, Problem) {
    let domain = pddl::parse_domain(domain);
    assert!(domain.is_ok(), "{:?}", domain.diagnostics);
    let problem = pddl::parse_problem(problem);
    assert!(problem.is_ok(), "{:?}", problem.diagnostics);
    (domain.value.expect("a domain"), problem.value.expect("a problem"))
}

/// Returns Fast Downward if it is installed. With `CI=true` the test fails if it is not.
#[track_caller]
pub(crate) fn fast_downward() -> Option<Installation> {
    match Installation::find(ExternalEngine::FastDownward) {
        Ok(found) => Some(found),
        Err(err) => absent(&format!("{err}: {}", err.help().unwrap_or_default())),
    }
}

/// Returns a Python that has unified-planning, if there is one. With `CI=true` the test fails if
/// there is none.
#[track_caller]
pub(crate) fn unified_planning() -> Option<PathBuf> {
    let has_it = std::process::Command::new("python3")
        .args(["-c", "import importlib.util, sys; sys.exit(not importlib.util.find_spec('unified_planning'))"])
        .status()
        .is_ok_and(|status| status.success());
    if has_it { Some("python3".into()) } else { absent("no python3 has unified-planning") }
}

#[track_caller]
fn absent<T>(why: &str) -> Option<T> {
    left_out::left_out(why);
    None
}

/// Plans with an engine for the texts of a domain and a problem.
#[track_caller]
pub(crate) fn run(
    installation: &Installation,
    domain: &str,
    problem: &str,
    options: &EngineOptions,
) -> Result<EngineOutcome, EngineError> {
    let (domain, problem) = parse(domain, problem);
    plan(installation, &domain, &problem, options, &Cancel::new())
}

/// Returns a stand-in for an engine: a shell script in the folder `tests/fake`, with these
/// arguments.
pub(crate) fn fake(engine: ExternalEngine, script: &str, arguments: &[&str]) -> Installation {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fake");
    let script: [OsString; 2] = ["sh".into(), folder.join(script).into()];
    let arguments = arguments.iter().map(|argument| OsString::from(*argument));
    Installation::of(engine, script.into_iter().chain(arguments))
}

/// Returns the text of a file of the repository.
pub(crate) fn repository(path: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../..").join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|err| panic!("{}: {err}", path.display()))
}

//! A camera of any driver, whose methods and events tests use directly.

use std::path::{Path, PathBuf};

use actuator::StateFolder;
use agent::{BuildCheck, Host, Resources};
use serde_json::{Value, json};

use super::*;

const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");

/// Time limit of every step, on a machine that is busy with other tests.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

fn blueprint(driver: &str, config: Value, state: Option<&Path>) -> Blueprint {
    let map = "(define (problem map) (:domain smart-office) (:init) (:goal (and)))";
    let ontology = pddl::parse_domain(ONTOLOGY).value.expect("a domain");
    let host = Host::new(ontology, pddl::parse_problem(map).value.expect("a map"));
    let mut resources = Resources::default();
    resources.insert(BuildCheck);
    if let Some(state) = state {
        resources.insert(StateFolder(state.to_owned()));
    }
    let host = Host { resources, ..host };
    let id = acl::AgentId::new("camera-1").expect("a name");
    Blueprint { id, driver: driver.to_owned(), config: config.into(), host: Arc::new(host) }
}

pub(crate) async fn perform(
    camera: &mut PtzCamera,
    method: &str,
    arguments: &[(&str, &str)],
) -> Result<MethodResult, MethodFailure> {
    let arguments = arguments.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned()));
    let call = MethodCall {
        action: String::new(),
        method: method.to_owned(),
        arguments: arguments.collect(),
    };
    match camera.perform(&call).await {
        Ok(done) => Ok(camera.on_success(&call, done)),
        Err(failure) => {
            camera.on_failure(&call, &failure);
            Err(failure)
        }
    }
}

/// Takes over what the camera reports, until `is_so`.
pub(crate) async fn until(camera: &mut PtzCamera, is_so: impl Fn(&PtzCamera) -> bool) {
    let wait = async {
        while !is_so(camera) {
            let event = camera.next_event().expect("a camera has events").await;
            event(camera);
        }
    };
    let waited = tokio::time::timeout(PATIENCE, wait).await;
    assert!(waited.is_ok(), "{:?} {:?} {:?}", camera.problem, camera.in_view, camera.missing);
}

pub(crate) fn facts(camera: &PtzCamera) -> String {
    camera.facts().iter().map(|fact| format!("{} ", fact.fact)).collect()
}

/// Returns a camera with a state folder, in which are its pictures.
pub(crate) fn camera_with(driver: &str, mut config: Value) -> (PtzCamera, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    config["folder"] = json!(folder.path().join("pictures"));
    let camera = camera(&blueprint(driver, config, Some(folder.path())));
    (camera.expect("a camera"), folder)
}

/// Takes over what the camera reports, until it requests a goal. Returns the goal.
pub(crate) async fn requested(camera: &mut PtzCamera) -> String {
    let noticed = async {
        loop {
            let event = camera.next_event().expect("a camera has events").await;
            let initiatives = event(camera);
            if !initiatives.is_empty() {
                return format!("{initiatives:?}");
            }
        }
    };
    tokio::time::timeout(PATIENCE, noticed).await.expect("motion is noticed")
}

/// Returns the reason why a config is refused.
pub(crate) fn refusal(driver: &str, config: Value) -> String {
    match camera(&blueprint(driver, config.clone(), None)) {
        Ok(_) => panic!("{config} is accepted"),
        Err(error) => error.to_string(),
    }
}

/// Returns the files in the folder of pictures that end with `extension`.
pub(crate) fn files(folder: &tempfile::TempDir, extension: &str) -> Vec<PathBuf> {
    let files = std::fs::read_dir(folder.path().join("pictures")).expect("a folder");
    let files = files.flatten().map(|entry| entry.path());
    files.filter(|path| path.extension().is_some_and(|found| found == extension)).collect()
}

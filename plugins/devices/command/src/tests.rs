//! Tests of programs that succeed, fail and hang, and of the errors for mistakes in an entry.

use std::sync::Arc;

use agent::Host;
use serde_json::{Value, json};

use super::*;

const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");

const MODEL: &str = "(define (agent c) (:domain smart-office)
    (:types brewer - object)
    (:predicates (brewed ?r - room) (clean ?c - brewer))
    (:objects c - brewer)
    (:init (clean c))
    (:action brew :agent ?c - brewer :parameters (?r - room)
      :precondition (clean ?c)
      :effect (and (brewed ?r) (not (clean ?c)) (increase (total-cost) 3))))";

fn blueprint(config: Value) -> Blueprint {
    let map = "(define (problem map) (:domain smart-office) (:init) (:goal (and)))";
    let ontology = pddl::parse_domain(ONTOLOGY).value.expect("a domain");
    let host = Host::new(ontology, pddl::parse_problem(map).value.expect("a map"));
    let id = acl::AgentId::new("c").expect("a name");
    Blueprint { id, driver: String::new(), config: config.into(), host: Arc::new(host) }
}

fn brewer(script: &str, more: Value) -> CommandActuator {
    let mut brew = json!({ "run": ["/bin/sh", "-c", script, "brew", "{r}"] });
    if let (Value::Object(brew), Value::Object(more)) = (&mut brew, more) {
        brew.extend(more);
    }
    commanded(&blueprint(json!({ "model": MODEL, "actions": { "brew": brew } }))).expect("right")
}

fn call_of_brew() -> MethodCall {
    let arguments = [("c", "c"), ("r", "kitchen")].map(|(key, value)| (key.into(), value.into()));
    let (action, method) = ("(brew c kitchen)".to_owned(), "brew".to_owned());
    MethodCall { action, method, arguments: arguments.into() }
}

async fn brew(device: &mut CommandActuator) -> Result<String, String> {
    let call = call_of_brew();
    match device.perform(&call).await {
        Ok(printed) => Ok(device.on_success(&call, printed).detail),
        Err(failure) => {
            device.on_failure(&call, &failure);
            Err(failure.to_string())
        }
    }
}

fn facts(device: &CommandActuator) -> Vec<String> {
    device.facts().iter().map(|fact| fact.fact.to_string()).collect()
}

#[tokio::test]
async fn a_successful_program_makes_the_effect_of_its_action_true() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("brewed");
    let mut device = brewer(
        &format!(
            "echo \"$1\" > {}; echo '(= (temperature kitchen) 21.5)'; echo done",
            file.display()
        ),
        json!({}),
    );
    assert_eq!(facts(&device), ["(clean c)"]);
    assert_eq!(brew(&mut device).await.as_deref(), Ok("done"));
    assert_eq!(std::fs::read_to_string(file).expect("it was written"), "kitchen\n");
    assert_eq!(facts(&device), ["(brewed kitchen)", "(= (temperature kitchen) 21.5)"]);
    assert_eq!(device.describe().model.actions.len(), 1);
    let method = &device.describe().methods["brew"];
    assert_eq!(method.arguments["r"], "?r");
}

#[tokio::test]
async fn a_failed_program_changes_nothing_and_an_ended_one_makes_facts_unknown() {
    let flood = "head -c 200000 /dev/zero";
    let too_much = "read the output of `/bin/sh`: it prints more than 64 KiB";
    for (script, time_out, expected, known) in [
        (
            "echo it is empty >&2; exit 3",
            "20s",
            "run `/bin/sh`: exit status: 3: it is empty",
            &["(clean c)"][..],
        ),
        ("sleep 60", "200ms", "finish within 200ms", UNKNOWN),
        ("kill -9 $$", "20s", "run `/bin/sh`: signal: 9 (SIGKILL)", UNKNOWN),
        (flood, "20s", too_much, UNKNOWN),
    ] {
        let mut device = brewer(script, json!({ "time-out": time_out }));
        assert_eq!(brew(&mut device).await, Err(expected.to_owned()));
        assert_eq!(facts(&device), known, "{script}");
        assert!(device.describe().model.actions.is_empty());
    }
}

/// The facts of the brewer after a program that was killed before it had finished.
const UNKNOWN: &[&str] = &["(unknown (brewed kitchen))", "(unknown (clean c))"];

#[tokio::test]
async fn a_cancelled_program_makes_its_effect_unknown() {
    let mut device = brewer("sleep 60", json!({}));
    device.on_failure(&call_of_brew(), &MethodFailure::GivenUp);
    assert_eq!(facts(&device), UNKNOWN);
    assert_eq!(device.describe().model.actions.len(), 1, "it has not failed");
}

#[tokio::test]
async fn a_fact_that_the_action_would_not_change_stays_known() {
    let mut device = brewer("true", json!({}));
    assert!(brew(&mut device).await.is_ok());
    assert_eq!(facts(&device), ["(brewed kitchen)"]);
    let hangs = MethodFailure::TimedOut(Duration::from_secs(1));
    device.on_failure(&call_of_brew(), &hangs);
    assert_eq!(facts(&device), ["(brewed kitchen)"], "it is brewed and not clean either way");
    // A later success makes the fact known again.
    let mut device = brewer("true", json!({}));
    device.on_failure(&call_of_brew(), &hangs);
    assert!(brew(&mut device).await.is_ok());
    assert_eq!(facts(&device), ["(brewed kitchen)"]);
}

#[tokio::test]
async fn a_program_prints_false_and_unknown_facts() {
    for (printed, known, detail) in [
        ("(not (brewed kitchen))", "(not (brewed kitchen))", "(brew c kitchen) is done"),
        ("(unknown (brewed kitchen))", "(unknown (brewed kitchen))", "(brew c kitchen) is done"),
        ("(at 5 (brewed kitchen))", "(brewed kitchen)", "(at 5 (brewed kitchen))"),
    ] {
        let mut device = brewer(&format!("echo '{printed}'"), json!({}));
        assert_eq!(brew(&mut device).await.as_deref(), Ok(detail));
        assert_eq!(facts(&device), [known]);
    }
}

#[tokio::test]
async fn facts_outlive_the_daemon() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, copy) = (folder.path().join("c.facts"), folder.path().join("copy"));
    let with = |model: &str, script: &str| {
        let run = json!({ "run": ["/bin/sh", "-c", script] });
        let mut blueprint = blueprint(json!({ "model": model, "actions": { "brew": run } }));
        let host = Arc::get_mut(&mut blueprint.host).expect("the only one");
        host.resources.insert(agent::StateFolder(folder.path().to_owned()));
        commanded(&blueprint)
    };
    let restarted = |model: &str| facts(&with(model, "true").expect("right"));
    assert_eq!(restarted(MODEL), ["(clean c)"]);
    // The program sees the facts that a daemon would find if it were killed now.
    let copying = format!("cp {} {}", file.display(), copy.display());
    let mut device = with(MODEL, &copying).expect("right");
    assert!(brew(&mut device).await.is_ok());
    assert_eq!(restarted(MODEL), ["(brewed kitchen)"]);
    std::fs::rename(&copy, &file).expect("the program has made it");
    assert_eq!(restarted(MODEL), UNKNOWN);
    let mut device = with(MODEL, "echo '(= (temperature kitchen) 21.5)'").expect("right");
    assert!(brew(&mut device).await.is_ok());
    let known = ["(brewed kitchen)", "(= (temperature kitchen) 21.5)"];
    assert_eq!(
        (facts(&device), restarted(MODEL)),
        (known.map(String::from).into(), facts(&device))
    );
    // A program that failed has changed nothing.
    let mut device = with(MODEL, "exit 1").expect("right");
    assert!(brew(&mut device).await.is_err());
    assert_eq!(restarted(MODEL), known);
    let other = MODEL.replace("(:init (clean c))", "(:init (brewed hall))");
    assert_eq!(restarted(&other), ["(brewed hall)"], "another model");
    let text = std::fs::read_to_string(&file).expect("it is there");
    std::fs::write(&file, text.replace("kitchen)", "kitchen")).expect("a file");
    let problem = with(MODEL, "true").err().map(|error| error.to_string()).unwrap_or_default();
    assert!(problem.contains("c.facts") && problem.contains("remove the file"), "{problem}");
}

#[test]
fn errors_of_an_entry_name_the_correction() {
    let run = json!({ "run": ["true"] });
    let with = |from: &str, to: &str| MODEL.replace(from, to);
    for (model, actions, expected) in [
        (MODEL.to_owned(), json!({}), "`brew` has no program: actions.brew = { run = [\"…\"] }"),
        (
            MODEL.to_owned(),
            json!({ "brew": run, "boil": run }),
            "actions.boil: the model has brew, and no `boil`",
        ),
        (
            MODEL.to_owned(),
            json!({ "brew": { "run": ["true", "{room}"] } }),
            "actions.brew: `{room}` is none of its variables: {c}, {r}",
        ),
        (
            MODEL.to_owned(),
            json!({ "brew": { "run": ["true", "at {{ r }}"] } }),
            "actions.brew: `{{ r }}` is no placeholder: write `{r}`",
        ),
        (
            MODEL.to_owned(),
            json!({ "brew": { "run": ["true", "?r"] } }),
            "actions.brew: `?r` is no placeholder: write `{r}`",
        ),
        (
            MODEL.to_owned(),
            json!({ "brew": { "run": ["true", "{r.x}"] } }),
            "actions.brew: `{r.x}`: a program gets the names of objects, and no values: write `{r}`",
        ),
        (
            MODEL.to_owned(),
            json!({ "brew": { "run": [] } }),
            "actions.brew: write run = [\"PROGRAM\", \"ARGUMENT\"]",
        ),
        (
            with("(agent c)", "(agent d)"),
            json!({ "brew": run }),
            "model:1:16: error: it is for `d`; write (define (agent c) …",
        ),
        (
            with("(increase (total-cost) 3)", "(when (clean ?c) (brewed ?r))"),
            json!({ "brew": run }),
            "actions.brew: its effect has `forall` or `when`: say what is true whenever the \
             program ends well, and let it print the rest",
        ),
        (
            with("(increase (total-cost) 3)", "(increase (temperature ?r) 3)"),
            json!({ "brew": run }),
            "actions.brew: its effect changes (temperature ?r), which only the program can know: \
             let it print the number, as in (= (temperature ?r) 21.5)",
        ),
    ] {
        let built = commanded(&blueprint(json!({ "model": model, "actions": actions })));
        let problem = built.err().map(|error| error.to_string()).unwrap_or_default();
        assert_eq!(problem, format!("build `c`: {expected}"));
    }
    for (model, expected) in [
        (with(":precondition", ":preconditon"), "model:7:"),
        (with(":agent ?c - brewer", ":agent ?c - foo"), "model:6:31: error: unknown type `foo`"),
        (with("(brewed ?r) (not", "(bar) (not"), "model:8:21: error: unknown predicate `bar`"),
        (with(":precondition (clean ?c)", ":precondition (cleen ?c)"), "unknown predicate `cleen`"),
        (with("(:init (clean c))", "(:init (cleen c))"), "unknown predicate `cleen`"),
        (with("(brewed ?r) (not", "(brewed ?r ?r) (not"), "model:8:"),
    ] {
        let built = commanded(&blueprint(json!({ "model": model, "actions": { "brew": run } })));
        let problem = built.err().map(|error| error.to_string()).unwrap_or_default();
        assert!(problem.starts_with("build `c`: model:"), "{problem}");
        assert!(problem.contains(expected), "{problem} is not {expected}");
    }
}

//! Tests of the camera: its pictures, its observations, and scenario 3 of the paper.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use ::building::{BuildingEvent, Truth};
use acl::content::{Inform, Keep, OpenQuestion, PersonsAnswer, Question};
use acl::{AgentId, Message, Performative};
use agent::{Agent, Callbacks, Context, Mode, Participation, Resource, ResourceQuery};
use keyboard::UserRequest;
use substrate::memory::Network;

use super::{MODES, Office, PATIENCE, entry};

/// Returns the entry of a camera in the corridor that sees the entry and office1.
fn camera(more: &str) -> String {
    let config = format!(
        "{{ location = \"corridor\", folder = \"{{folder}}/pictures\", record-seconds = 1.0, \
         presets = {{ door = {{ shows = \"corridor\" }}, \
         desk = {{ shows = \"office1\", pan = 80.0, zoom = 2.0 }} }}{more} }}"
    );
    entry("camera-1", "ptz-camera", &config)
}

/// Returns the entry of a robot with a screen at which people log in.
fn robot(login: &str) -> String {
    let config = format!("{{ start = \"office2\", login = {{ {login} }} }}");
    entry("turtlebot-1", "turtlebot", &config)
}

fn files(office: &Office, kind: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(office.folder.path().join("pictures"));
    let paths = entries.expect("the album").map(|entry| entry.expect("an entry").path());
    paths.filter(|path| path.extension().is_some_and(|extension| extension == kind)).collect()
}

#[tokio::test(start_paused = true)]
async fn pictures_and_videos_are_files_of_what_is_there() {
    for mode in MODES {
        let office = Office::open(&[camera("")], mode).await;
        let mut person = office.person("user");
        office.building.enter("alice", "office1").expect("it is there");
        assert!(person.reaches("(known-picture office1)").await, "{:#?}", person.lines);
        assert_eq!(office.building.truth().seen_by("camera-1"), ["office1"]);
        let pictures = files(&office, "ppm");
        assert_eq!(pictures.len(), 1);
        let picture = std::fs::read(&pictures[0]).expect("a picture");
        assert!(picture.starts_with(b"P6\n# office1: alice\n160 120\n255\n"), "{mode:?}");
        assert!(person.reaches("(recorded corridor)").await, "{:#?}", person.lines);
        assert_eq!(office.building.truth().seen_by("camera-1"), ["corridor"]);
        let videos = files(&office, "y4m");
        let video = std::fs::read(&videos[0]).expect("a video");
        assert!(video.starts_with(b"YUV4MPEG2 W160 H120 F5:1 "), "{mode:?}");
        assert!(video.len() > 5 * 160 * 120 * 3 / 2, "five frames in a second");
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn motion_is_reported_unrequested_while_it_lasts() {
    let more = ", motion-for = \"20s\"";
    let office = Office::open(&[camera(more)], Mode::Decentralized).await;
    let mut person = office.person("user");
    assert!(!person.reaches("(motion corridor)").await, "nothing moves: {:#?}", person.lines);
    office.building.set_motion("corridor", true).expect("it is there");
    tokio::time::sleep(std::time::Duration::from_secs(5)).await;
    assert!(person.reaches("(motion corridor)").await, "{:#?}", person.lines);
    office.building.set_motion("corridor", false).expect("it is there");
    tokio::time::sleep(std::time::Duration::from_secs(60)).await;
    assert!(!person.reaches("(motion corridor)").await, "{:#?}", person.lines);
    office.close().await;
}

// === scenario 3 ===

/// A person at a keyboard that answers each question with the next text in `answers`.
struct Visitor {
    answers: VecDeque<&'static str>,
}

impl Agent for Visitor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(Performative::QueryRef, Self::queried)
    }
}

impl Visitor {
    fn queried(&mut self, message: Message, ctx: &mut Context<Self>) {
        let Ok(Question { .. }) = message.content_as() else { panic!("{message:?}") };
        let Some(text) = self.answers.pop_front().map(str::to_owned) else { return };
        ctx.answer(
            &Participation::of(&message),
            Performative::Inform,
            &Inform::Answer(PersonsAnswer::plain(text)),
        );
    }
}

fn visit(office: &Office, name: &str, answers: &[&'static str]) {
    let id = AgentId::new(name).expect("a name");
    let visitor = Visitor { answers: answers.iter().copied().collect() };
    office.node.launch(id, visitor, office.ecosystem.domain.name.as_str());
}

fn arrived(truth: &Truth) -> bool {
    truth.any(|event| matches!(event, BuildingEvent::Moved { to, .. } if to == "corridor"))
}

const ON_MOTION: &str = ", on-motion = { goal = \"(validated ?l)\", priority = 5 }";

#[tokio::test(start_paused = true)]
async fn a_visitor_is_seen_and_validated_at_the_robot() {
    for mode in MODES {
        let entries = [camera(ON_MOTION), robot("pin = \"2718\"")];
        let office = Office::open(&entries, mode).await;
        let mut visitor = office.person("terminal");
        tokio::time::sleep(std::time::Duration::from_secs(2)).await;
        office.building.enter("alice", "corridor").expect("it is there");
        office.until("the robot goes there", arrived).await;
        visitor.answers("2718").await;
        let mut person = office.person("user");
        assert!(person.reaches("(validated corridor)").await, "{mode:?} {:#?}", person.lines);
        office.close().await;
    }
}

/// Requests that a person is validated, while two people answer with `first` and `second`. Returns
/// `true` if the goal was reached.
async fn validates(login: &str, first: &[&'static str], second: &[&'static str]) -> bool {
    let office = Office::open(&[robot(login)], Mode::Decentralized).await;
    visit(&office, "terminal-1", first);
    visit(&office, "terminal-2", second);
    let mut person = office.person("user");
    let reached = person.reaches("(validated office2)").await;
    let told = format!("{:#?}", person.lines);
    assert!(!told.contains("2718") && !told.contains("1111"), "it tells secrets: {told}");
    office.close().await;
    reached
}

#[tokio::test(start_paused = true)]
async fn the_right_pin_counts_from_any_person() {
    let login = "pin = \"2718\", attempts = 2, patience = \"30s\"";
    assert!(validates(login, &["2718"], &["2718"]).await, "two right answers at once");
    assert!(validates(login, &["1111", "2718"], &[]).await, "wrong, then right");
    assert!(validates(login, &["1111"], &["1111", "2718"]).await, "two wrong ones, then right");
    let guesses = &["1111", "1111", "2718"];
    assert!(!validates(login, guesses, &[]).await, "two wrong ones, and it is locked");
    assert!(!validates(login, &[], &[]).await, "nobody is there");
}

#[tokio::test(start_paused = true)]
async fn an_answered_question_is_closed_at_other_keyboards() {
    let office = Office::open(&[robot("pin = \"2718\"")], Mode::Decentralized).await;
    let (mut asker, mut here, mut there) =
        (office.person("user"), office.person("here"), office.person("there"));
    asker.wish("(validated office2)", Keep::Achieve).await;
    let question = there.is_asked().await;
    here.answers("2718").await;
    let (closed, why) = there.hears_closed().await;
    assert_eq!((closed, &*why), (question, "withdrawn: answered at `here`"));
    assert!(asker.hears().await, "{:#?}", asker.lines);
    // A query for open questions returns none, and an answer to a closed question is refused.
    let ask = ResourceQuery { daemon: None, resource: Resource::Questions, agent: None };
    let answers = office.node.router().ask(ask, PATIENCE).await;
    let open = answers
        .iter()
        .flat_map(|answer| serde_json::from_slice::<Vec<OpenQuestion>>(answer).expect("questions"));
    assert_eq!(open.count(), 0);
    let keyboard = AgentId::new("there").expect("a name");
    let text = "2718".to_owned();
    let said = UserRequest::Answer { keyboard, question, text, seal_to: None };
    there.terminal.requests.send(said).await.expect("the keyboard listens");
    assert!(!there.hears().await);
    assert!(there.lines[0].contains("has no open question"), "{:?}", there.lines);
    office.close().await;
}

/// In an ecosystem without keys, a foreign tool on the network receives every message, also the
/// message by which a person answers a question that another keyboard has received.
#[tokio::test(start_paused = true)]
async fn a_pin_never_appears_on_the_network() {
    const PIN: &str = "31415";
    let (network, said) = (Network::new(), Arc::new(Mutex::new(Vec::new())));
    let heard = Arc::clone(&said);
    network.tap(move |_, payload| {
        let text = String::from_utf8_lossy(payload).into_owned();
        heard.lock().expect("no panic").push(text);
    });
    let robot = robot(&format!("pin = \"{PIN}\""));
    let office = Office::open_on(network, &[robot], Mode::Decentralized).await;
    let (mut asker, mut there) = (office.person("user"), office.person("there"));
    let guest = office.person("guest");
    asker.wish("(validated office2)", Keep::Achieve).await;
    let question = there.is_asked().await;
    let ask = ResourceQuery { daemon: None, resource: Resource::Questions, agent: None };
    let answers = office.node.router().ask(ask, PATIENCE).await;
    let mut open = answers
        .iter()
        .flat_map(|answer| serde_json::from_slice::<Vec<OpenQuestion>>(answer).expect("questions"));
    let is_there = |open: &OpenQuestion| open.keyboard.as_str() == "there";
    let OpenQuestion { keyboard, seal_to, .. } = open.find(is_there).expect("it is open");
    let said_there = UserRequest::Answer { keyboard, question, text: PIN.to_owned(), seal_to };
    guest.terminal.requests.send(said_there).await.expect("the keyboard listens");
    assert!(asker.hears().await, "the robot has read it: {:#?}", asker.lines);
    office.close().await;

    let said = said.lock().expect("no panic").clone();
    let tells: Vec<_> = said.iter().filter(|text| text.contains(PIN)).collect();
    assert!(tells.is_empty(), "{tells:?}");
    let answers = said.iter().filter(|text| text.contains("\"sealed\""));
    assert!(answers.count() >= 2, "to the keyboard, and to the robot: {said:#?}");
}

#[tokio::test(start_paused = true)]
async fn a_question_ends_with_the_goal_that_it_was_asked_for() {
    let office = Office::open(&[robot("pin = \"2718\"")], Mode::Centralized).await;
    let (mut asker, mut there) = (office.person("user"), office.person("there"));
    asker.wish("(validated office2)", Keep::Achieve).await;
    let goal = asker.waits(|heard| heard.conversation().cloned()).await;
    let question = there.is_asked().await;
    asker.terminal.requests.send(UserRequest::Cancel(goal)).await.expect("the keyboard listens");
    let (closed, why) = there.hears_closed().await;
    let expected = "withdrawn: the answer is not needed any more";
    assert_eq!((closed, &*why), (question, expected));
    office.close().await;
}

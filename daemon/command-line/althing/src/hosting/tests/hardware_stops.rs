//! Tests of hardware stops: a contact that is opened stops a robot on the way, by the building's
//! truth.

use std::time::Duration;

use ::building::{BuildingEvent, DeviceFault, Quantity};
use acl::content::{Keep, ReleaseStops, Request, value};
use acl::{AgentId, Performative, Protocol};
use agent::StopRegistry;
use keyboard::{MessageDraft, UserRequest};

use super::{Mode, Office, Person, entry};

const OPEN: f64 = 0.0;
const CLOSED: f64 = 1.0;

/// Longer than a button may report nothing.
const SILENCE: Duration = Duration::from_secs(6);

/// Opens an office with a robot, a thermometer, and a button in the corridor that is not pressed.
async fn office(hardware_stop: &str) -> Office {
    let rest = format!(
        "[hardware-stops.button]\n{hardware_stop}\n\n\
         [building]\nconditions = {{ corridor = {{ contact = 1.0 }} }}\n\n"
    );
    let entries = [
        entry("turtlebot-1", "turtlebot", "{ start = \"corridor\" }"),
        entry("turtlebot-2", "turtlebot", "{ start = \"corridor\" }"),
        entry("button", "sensor", "{ quantity = \"contact\", location = \"corridor\" }"),
        rest,
    ];
    Office::open(&entries, Mode::Centralized).await
}

fn set(office: &Office, contact: f64) {
    office.building.set("corridor", Quantity::Contact, contact).expect("a corridor");
}

fn count(office: &Office, is_it: impl Fn(&BuildingEvent) -> bool) -> usize {
    let truth = office.building.truth();
    truth.occurrences().filter(|occurrence| is_it(&occurrence.event)).count()
}

fn departures(office: &Office) -> usize {
    count(office, |event| matches!(event, BuildingEvent::Departed { .. }))
}

fn arrivals(office: &Office) -> usize {
    count(office, |event| matches!(event, BuildingEvent::Moved { .. }))
}

/// Lets a person of their own request that the first robot drives to the first office, and waits
/// until it has departed.
async fn set_off(office: &Office) -> Person {
    let before = departures(office);
    let mut person = office.person("driver");
    person.wish("(at turtlebot-1 office1)", Keep::Achieve).await;
    let departed = |event: &BuildingEvent| matches!(event, BuildingEvent::Departed { .. });
    let sets_off = |truth: &::building::Truth| {
        truth.occurrences().filter(|occurrence| departed(&occurrence.event)).count() > before
    };
    office.until("it sets off", sets_off).await;
    person
}

async fn until_stayed(office: &Office) {
    let stayed = |event: &BuildingEvent| matches!(event, BuildingEvent::Stayed { .. });
    office.until("it stands still", |truth| truth.any(stayed)).await;
}

/// Returns the identifiers of the stops in force, which are all of the button.
fn stops(office: &Office) -> Vec<String> {
    let stops = office.node.host.as_ref().expect("a host").stops().in_force();
    assert!(stops.iter().all(|stop| stop.by.as_str() == "button"), "{stops:?}");
    stops.into_iter().map(|stop| stop.id).collect()
}

/// Waits until the stops have changed from those that are in force now.
async fn until_changed(office: &Office) {
    let host = office.node.host.as_ref().expect("a host");
    let mut changes = host.resources.get::<StopRegistry>().expect("stops").changes();
    tokio::time::timeout(super::PATIENCE, changes.next()).await.expect("in time");
}

/// Asks the robots, as this person, to release all stops. Returns the refusal of the first; `None` if both do.
async fn release(office: &Office, caretaker: &str) -> Option<String> {
    let (ids, mut person) = (stops(office), office.person(caretaker));
    for robot in ["turtlebot-1", "turtlebot-2"] {
        let draft = MessageDraft {
            to: Some(AgentId::new(robot).expect("a name")),
            performative: Performative::Request,
            protocol: Protocol::StateChange,
            conversation: None,
            content: value(&Request::ReleaseStops(ReleaseStops { ids: ids.clone() })),
            patience: SILENCE,
        };
        person.terminal.requests.send(UserRequest::Send(draft)).await.expect("it listens");
        let answer = person
            .waits(|heard| match heard {
                keyboard::UserEvent::Answered(_, message) => Some(message),
                _ => None,
            })
            .await;
        if answer.performative == Performative::Refuse {
            return Some(answer.content.to_string());
        }
    }
    None
}

#[tokio::test(start_paused = true)]
async fn a_pressed_button_stops_a_driving_robot_until_a_person_releases_it() {
    let office = office("fail-safe = false").await;
    let mut person = office.person("user");
    let _driver = set_off(&office).await;
    assert_eq!(stops(&office), [""; 0]);
    set(&office, OPEN);
    until_stayed(&office).await;
    assert_eq!((stops(&office).len(), arrivals(&office)), (1, 0));
    // It cannot be released while it is pressed, and stops afterwards, too.
    let refusal = release(&office, "ann").await.expect("a refusal");
    assert!(refusal.contains("`button` stops it: it is pressed"), "{refusal}");
    set(&office, CLOSED);
    tokio::time::sleep(SILENCE).await;
    assert_eq!(stops(&office).len(), 1, "a person has to release it");
    let before = departures(&office);
    assert!(!person.reaches("(at turtlebot-2 office2)").await, "{:#?}", person.lines);
    assert_eq!(departures(&office), before, "it has begun something");
    assert_eq!(release(&office, "ben").await, None);
    assert_eq!(stops(&office), [""; 0]);
    assert!(person.reaches("(at turtlebot-2 office2)").await, "{:#?}", person.lines);
    office.close().await;
}

#[tokio::test(start_paused = true)]
async fn a_button_stops_only_the_agents_and_places_that_it_names() {
    let office = office("stops = [\"turtlebot-1\"]\nfail-safe = true").await;
    let mut person = office.person("user");
    set(&office, OPEN);
    until_changed(&office).await;
    assert!(!person.reaches("(at turtlebot-1 office1)").await, "{:#?}", person.lines);
    assert!(person.reaches("(at turtlebot-2 office1)").await, "{:#?}", person.lines);
    assert_eq!(departures(&office), 1);
    office.close().await;
}

#[tokio::test(start_paused = true)]
async fn a_button_that_may_release_its_stop_does_so_when_it_is_not_pressed() {
    let office = office("release = \"button\"\nfail-safe = false").await;
    let mut person = office.person("user");
    let _driver = set_off(&office).await;
    set(&office, OPEN);
    until_stayed(&office).await;
    set(&office, CLOSED);
    until_changed(&office).await;
    assert_eq!(stops(&office), [""; 0]);
    assert!(person.reaches("(at turtlebot-2 office2)").await, "{:#?}", person.lines);
    office.close().await;
}

#[tokio::test(start_paused = true)]
async fn a_button_that_falls_silent_stops_everything_only_if_it_is_fail_safe() {
    for is_fail_safe in [true, false] {
        let office = office(&format!("fail-safe = {is_fail_safe}")).await;
        tokio::time::sleep(SILENCE).await;
        assert_eq!(stops(&office), [""; 0], "it reports that it is not pressed");
        let _driver = set_off(&office).await;
        office.node.abort_agent(&AgentId::new("button").expect("a name"));
        if is_fail_safe {
            until_stayed(&office).await;
            assert_eq!(stops(&office).len(), 1);
            let refusal = release(&office, "ann").await.expect("a refusal");
            assert!(refusal.contains("it is silent, which counts as pressed"), "{refusal}");
        } else {
            office
                .until("it arrives", |truth| truth.place_of("turtlebot-1") == Some("office1"))
                .await;
            assert_eq!(stops(&office), [""; 0]);
        }
        office.close().await;
    }
}

/// Its agent is there, and its wire is not.
#[tokio::test(start_paused = true)]
async fn a_button_that_cannot_be_read_counts_as_pressed_if_it_is_fail_safe() {
    let office = office("release = \"button\"\nfail-safe = true").await;
    office.building.break_device("button", DeviceFault::Fails).expect("it is there");
    set(&office, OPEN);
    until_changed(&office).await;
    assert_eq!(stops(&office).len(), 1);
    office.close().await;
}

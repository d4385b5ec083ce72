//! Hardware stops: sensors that stop actuators while they report to be pressed.
//!
//! - Every daemon decides by itself, from the facts in the heartbeats of a button's agent: no other
//!   agent has to be alive. The button's own daemon decides first, and the heartbeats of its
//!   actuators then repeat the stop, as they repeat every stop.
//! - All daemons give one press the same identifier, so that it is one stop everywhere.
//! - A stop of a button cannot be released while the button is pressed. If the file says so, the stop
//!   is released when the button's agent reports that the button is not pressed any more.
//! - A button is silent if its agent is absent, or reports neither one nor the other, for a while. If
//!   the file says so, a silent button counts as pressed.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::content::{ButtonPosition, ButtonReport, Heartbeat, Stop};
use acl::fnv::Fnv64;
use acl::{AgentId, Incarnation};
use pddl::{Atom, InitElement};
use tokio::time::Instant;

use crate::stops::StopRegistry;

/// The rule of the ecosystem file for one hardware stop.
#[derive(Clone, Debug, PartialEq)]
pub struct StopButton {
    /// Names of the agents and places that it stops; empty for everything.
    pub scope: Vec<String>,
    /// When the button counts as pressed.
    pub pressed: PressedWhen,
    /// Whether the stop is released when the button is not pressed any more; otherwise by a person.
    pub is_self_releasing: bool,
    /// Whether a silent button counts as pressed.
    pub is_fail_safe: bool,
}

/// Facts of a button's agent by which the button counts as pressed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PressedWhen {
    /// Its contact is open, as that of an emergency stop is; a cable that is cut opens it, too.
    ContactOpen,
    /// Its contact is closed.
    ContactClosed,
    /// The fact of this text is true.
    FactHolds(String),
    /// The fact of this text is false.
    FactFails(String),
}

/// Resource of a host: the hardware stops of the ecosystem, and the last report of each that this
/// daemon has received.
#[derive(Debug)]
pub struct StopButtons {
    rules: BTreeMap<AgentId, StopButton>,
    /// How long a button may report nothing before it counts as silent.
    silence: Duration,
    states: Mutex<BTreeMap<AgentId, ButtonState>>,
}

/// Last report of one button.
#[derive(Clone, Copy, Debug, Default)]
struct ButtonState {
    /// Incarnation of its agent that was heard last.
    incarnation: Incarnation,
    /// Sequence number of the last heartbeat of that incarnation.
    sequence: u64,
    /// `None` if it is not known.
    is_pressed: Option<bool>,
    /// When it became unknown whether the button is pressed.
    unknown_since: Option<Instant>,
}

// === impl PressedWhen ===

impl PressedWhen {
    /// Returns whether the button is pressed, according to the facts of its agent; `None` if they do
    /// not tell it.
    pub fn is_pressed(&self, button: &AgentId, facts: &[InitElement]) -> Option<bool> {
        let is_contact = |atom: &Atom| {
            let first = atom.arguments.first().map(ToString::to_string);
            let is_own = first.is_some_and(|first| first.eq_ignore_ascii_case(button.as_str()));
            // In an ontology that derives `closed`, a contact is `shut`.
            atom.predicate == "closed" || (atom.predicate == "shut" && is_own)
        };
        let is_fact = |text: &String| {
            let text = text.clone();
            move |atom: &Atom| atom.to_string().eq_ignore_ascii_case(&text)
        };
        match self {
            PressedWhen::ContactOpen => told(facts, is_contact)?.map(|is_closed| !is_closed),
            PressedWhen::ContactClosed => told(facts, is_contact)?,
            // A fact that an agent owns and does not report is false.
            PressedWhen::FactHolds(text) => told(facts, is_fact(text)).unwrap_or(Some(false)),
            PressedWhen::FactFails(text) => {
                told(facts, is_fact(text)).unwrap_or(Some(false)).map(|holds| !holds)
            }
        }
    }
}

/// Returns the truth of the first fact for which `is_it` is true: `Some(None)` if it is unknown, and
/// `None` if there is no such fact.
fn told(facts: &[InitElement], is_it: impl Fn(&Atom) -> bool) -> Option<Option<bool>> {
    facts.iter().find_map(|fact| match fact {
        InitElement::Atom(atom) if is_it(atom) => Some(Some(true)),
        InitElement::Not(atom) if is_it(atom) => Some(Some(false)),
        InitElement::Unknown(atom) if is_it(atom) => Some(None),
        _ => None,
    })
}

// === impl StopButtons ===

impl StopButtons {
    /// Creates the hardware stops of an ecosystem, of which nothing is known yet. A button that
    /// reports nothing for longer than `silence` is silent.
    pub fn new(rules: BTreeMap<AgentId, StopButton>, silence: Duration) -> StopButtons {
        StopButtons { rules, silence, states: Mutex::default() }
    }

    /// Returns the agents of the buttons.
    pub fn names(&self) -> impl Iterator<Item = &AgentId> {
        self.rules.keys()
    }

    /// Whether a heartbeat must be read although it repeats the one before: it is that of a button
    /// whose position is not known.
    pub(crate) fn must_read(&self, sender: &AgentId) -> bool {
        let is_known = |state: &ButtonState| state.is_pressed.is_some();
        self.rules.contains_key(sender) && !self.states().get(sender).is_some_and(is_known)
    }

    /// Takes the facts that an agent reports now, if it is a button.
    pub fn hear(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        facts: &[InitElement],
        now: Instant,
    ) {
        let Some(rule) = self.rules.get(agent) else { return };
        let is_pressed = rule.pressed.is_pressed(agent, facts);
        let mut states = self.states();
        let state = states.entry(agent.clone()).or_default();
        (state.incarnation, state.is_pressed) = (incarnation, is_pressed);
        state.note_silence(now);
    }

    /// Takes the heartbeat of an agent, and returns whether it is a button.
    pub(crate) fn hear_heartbeat(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        heartbeat: &Heartbeat,
        now: Instant,
    ) -> bool {
        let Some(rule) = self.rules.get(agent) else { return false };
        let passing = heartbeat.known_for.keys().map(String::as_str);
        let texts = passing.chain([heartbeat.facts.as_str()]);
        let read: Result<Vec<_>, _> =
            texts.map(|text| pddl::parse_init_elements(text).into_result()).collect();
        // What cannot be read tells nothing: it is no report that the button is not pressed.
        let is_pressed =
            read.ok().and_then(|facts| rule.pressed.is_pressed(agent, &facts.concat()));
        let mut states = self.states();
        let state = states.entry(agent.clone()).or_default();
        // A heartbeat may come late, in the answer to a query or over a slow link.
        if (incarnation, heartbeat.sequence) >= (state.incarnation, state.sequence) {
            *state = ButtonState {
                incarnation,
                sequence: heartbeat.sequence,
                is_pressed,
                unknown_since: state.unknown_since,
            };
            state.note_silence(now);
        }
        true
    }

    /// Records that the agent of a button is absent.
    pub fn miss(&self, button: &AgentId, now: Instant) {
        if self.rules.contains_key(button) {
            let mut states = self.states();
            let state = states.entry(button.clone()).or_default();
            state.is_pressed = None;
            state.note_silence(now);
        }
    }

    /// Adds the stops of the buttons that are pressed, or count as pressed, to the stops of this
    /// daemon. Releases those of self-releasing buttons that are not pressed any more.
    pub fn apply(&self, stops: &StopRegistry, now: Instant) {
        let mut states = self.states();
        for (button, rule) in &self.rules {
            let state = states.entry(button.clone()).or_default();
            state.note_silence(now);
            match self.why_stopped(rule, state, now) {
                Some(why) if stops.find(|stop| stop.by == *button).is_none() => {
                    let id = free_id(button, state.incarnation, stops);
                    let (scope, by) = (rule.scope.clone(), button.clone());
                    tracing::warn!(stop = id, %button, why, "stopped by a hardware stop");
                    // The stop may hold long after the button is released.
                    let why = why.replacen("it is", "it was", 1).replace("counts", "counted");
                    stops.add(&Stop { id, scope, by, why });
                }
                None if rule.is_self_releasing && state.is_pressed == Some(false) => {
                    let own = stops.in_force().into_iter().filter(|stop| stop.by == *button);
                    let own: Vec<String> = own.map(|stop| stop.id).collect();
                    for id in stops.release(&own) {
                        tracing::warn!(stop = id, %button, "released: it is not pressed any more");
                    }
                }
                Some(_) | None => (),
            }
        }
    }

    /// Returns why the stop `id` may not be released; `None` if it may.
    pub fn objection(&self, stops: &StopRegistry, id: &str, now: Instant) -> Option<String> {
        let stop = stops.find(|stop| stop.id == id)?;
        let rule = self.rules.get(&stop.by)?;
        let state = self.states().get(&stop.by).copied().unwrap_or_default();
        let why = self.why_stopped(rule, &state, now)?;
        Some(format!("`{}` stops it: {why}", stop.by))
    }

    /// Returns the position of each button, as it is known here.
    pub fn reports(&self, now: Instant) -> Vec<ButtonReport> {
        let states = self.states();
        let report = |button: &AgentId| {
            let state = states.get(button).copied().unwrap_or_default();
            let position = match state.is_pressed {
                Some(true) => ButtonPosition::Pressed,
                Some(false) => ButtonPosition::NotPressed,
                None if state.is_silent(self.silence, now) => ButtonPosition::Silent,
                None => ButtonPosition::Unknown,
            };
            ButtonReport { button: button.clone(), position }
        };
        self.rules.keys().map(report).collect()
    }

    /// Returns why a button stops actuators now; `None` if it does not.
    fn why_stopped(
        &self,
        rule: &StopButton,
        state: &ButtonState,
        now: Instant,
    ) -> Option<&'static str> {
        match state.is_pressed {
            Some(true) => Some("it is pressed"),
            None if rule.is_fail_safe && state.is_silent(self.silence, now) => {
                Some("it is silent, which counts as pressed")
            }
            Some(false) | None => None,
        }
    }

    fn states(&self) -> MutexGuard<'_, BTreeMap<AgentId, ButtonState>> {
        self.states.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ButtonState {
    fn note_silence(&mut self, now: Instant) {
        self.unknown_since = match self.is_pressed {
            Some(_) => None,
            None => self.unknown_since.or(Some(now)),
        };
    }

    fn is_silent(&self, silence: Duration, now: Instant) -> bool {
        self.unknown_since.is_some_and(|since| now.saturating_duration_since(since) > silence)
    }
}

/// Returns an identifier for the next stop of a button: the first of a series that no stop here has
/// had. The series follows from the button, so that all daemons choose the same identifier.
fn free_id(button: &AgentId, incarnation: Incarnation, stops: &StopRegistry) -> String {
    let series = Fnv64::default().with(button.as_str().as_bytes());
    let series = series.with(&incarnation.0.to_be_bytes());
    let mut ids = (0_u64..).map(|number| {
        let hash = series.with(&number.to_be_bytes()).value();
        // Eight digits, as the identifiers of `althing stop` have.
        format!("{:08x}", (hash ^ (hash >> 32)) & 0xffff_ffff)
    });
    // The registry remembers finitely many stops, so one of the series is always free.
    ids.find(|id| !stops.remembers(id)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SILENCE: Duration = Duration::from_secs(3);

    fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    fn facts(text: &str) -> Vec<InitElement> {
        pddl::parse_init_elements(text).into_result().expect("PDDL")
    }

    fn buttons(is_self_releasing: bool, is_fail_safe: bool) -> StopButtons {
        let scope = vec!["hall".to_owned()];
        let pressed = PressedWhen::ContactOpen;
        let rule = StopButton { scope, pressed, is_self_releasing, is_fail_safe };
        StopButtons::new([(agent("button"), rule)].into(), SILENCE)
    }

    const OPEN: &str = "(located button hall) (known-contact hall) (not (shut button))";
    const SHUT: &str = "(located button hall) (known-contact hall) (shut button)";
    const UNKNOWN: &str =
        "(located button hall) (not (known-contact hall)) (unknown (shut button))";

    fn hear(buttons: &StopButtons, text: &str, stops: &StopRegistry, now: Instant) {
        buttons.hear(&agent("button"), Incarnation(7), &facts(text), now);
        buttons.apply(stops, now);
    }

    fn ids(stops: &StopRegistry) -> Vec<String> {
        stops.in_force().into_iter().map(|stop| stop.id).collect()
    }

    #[test]
    fn a_button_is_pressed_by_its_contact_or_by_a_fact() {
        let own = |text: &str| text.to_owned();
        let (open, closed) = (PressedWhen::ContactOpen, PressedWhen::ContactClosed);
        let holds = PressedWhen::FactHolds(own("(pressed button)"));
        let fails = PressedWhen::FactFails(own("(ready button)"));
        for (rule, text, expected) in [
            (&open, OPEN, Some(true)),
            (&open, SHUT, Some(false)),
            (&open, UNKNOWN, None),
            (&open, "(not (closed hall))", Some(true)),
            (&open, "(shut other)", None),
            (&closed, SHUT, Some(true)),
            (&closed, OPEN, Some(false)),
            (&closed, "", None),
            (&holds, "(Pressed button)", Some(true)),
            (&holds, "(not (pressed button))", Some(false)),
            (&holds, "(unknown (pressed button))", None),
            (&holds, "(pressed other)", Some(false)),
            (&fails, "(ready button)", Some(false)),
            (&fails, "", Some(true)),
            (&fails, "(unknown (ready button))", None),
        ] {
            let is_pressed = rule.is_pressed(&agent("button"), &facts(text));
            assert_eq!(is_pressed, expected, "{rule:?} {text}");
        }
    }

    #[test]
    fn a_pressed_button_stops_until_a_person_releases_it() {
        let (buttons, stops, now) =
            (buttons(false, false), StopRegistry::default(), Instant::now());
        hear(&buttons, SHUT, &stops, now);
        assert_eq!(stops.in_force(), []);
        hear(&buttons, OPEN, &stops, now);
        hear(&buttons, OPEN, &stops, now);
        let [stop] = &stops.in_force()[..] else { panic!("{:?}", stops.in_force()) };
        assert_eq!((stop.by.as_str(), stop.scope.as_slice()), ("button", &["hall".to_owned()][..]));
        // As long as it is pressed, it cannot be released; and if it is nevertheless, it stops anew.
        let why = buttons.objection(&stops, &stop.id, now).expect("it is pressed");
        assert_eq!(why, "`button` stops it: it is pressed");
        stops.release(std::slice::from_ref(&stop.id));
        buttons.apply(&stops, now);
        let again = ids(&stops);
        assert!(again.len() == 1 && again[0] != stop.id, "{again:?}");
        // A button that is not pressed any more is released by a person only.
        hear(&buttons, SHUT, &stops, now);
        assert_eq!(ids(&stops), again);
        assert_eq!(buttons.objection(&stops, &again[0], now), None);
        stops.release(&again);
        buttons.apply(&stops, now);
        assert_eq!(stops.in_force(), []);
    }

    #[test]
    fn a_button_releases_its_own_stops_if_the_file_says_so() {
        let (buttons, stops, now) = (buttons(true, false), StopRegistry::default(), Instant::now());
        let other = Stop { id: "x".into(), scope: vec![], by: agent("ann"), why: String::new() };
        stops.add(&other);
        hear(&buttons, OPEN, &stops, now);
        assert_eq!(stops.in_force().len(), 2);
        // Silence releases nothing.
        hear(&buttons, UNKNOWN, &stops, now);
        assert_eq!(stops.in_force().len(), 2);
        hear(&buttons, SHUT, &stops, now);
        assert_eq!(stops.in_force(), [other]);
    }

    #[test]
    fn a_silent_button_counts_as_pressed_if_it_is_fail_safe() {
        for is_fail_safe in [false, true] {
            let (buttons, stops) = (buttons(true, is_fail_safe), StopRegistry::default());
            let start = Instant::now();
            let later = start + SILENCE + Duration::from_millis(1);
            buttons.apply(&stops, start);
            hear(&buttons, UNKNOWN, &stops, start + SILENCE);
            assert_eq!(stops.in_force(), [], "it may just have started");
            buttons.apply(&stops, later);
            assert_eq!(stops.in_force().len(), usize::from(is_fail_safe));
            let [report] = &buttons.reports(later)[..] else { panic!("one button") };
            assert_eq!(report.position, ButtonPosition::Silent);
            hear(&buttons, SHUT, &stops, later);
            assert_eq!(stops.in_force(), [], "it is heard again");
            buttons.miss(&agent("button"), later);
            buttons.apply(&stops, later + SILENCE);
            assert_eq!(stops.in_force(), []);
            buttons.apply(&stops, later + SILENCE * 2);
            assert_eq!(stops.in_force().len(), usize::from(is_fail_safe));
        }
    }

    #[test]
    fn a_late_or_unreadable_heartbeat_releases_nothing() {
        let (buttons, stops, now) = (buttons(true, false), StopRegistry::default(), Instant::now());
        let hear = |incarnation: u64, sequence: u64, facts: &str| {
            let heartbeat = Heartbeat {
                digest: String::new(),
                sequence,
                facts: facts.to_owned(),
                known_for: BTreeMap::new(),
                period: 1_000.into(),
                stops: Vec::new(),
            };
            let incarnation = Incarnation(incarnation);
            assert!(buttons.hear_heartbeat(&agent("button"), incarnation, &heartbeat, now));
            buttons.apply(&stops, now);
            stops.in_force().len()
        };
        assert_eq!(hear(7, 101, OPEN), 1);
        assert_eq!(hear(7, 100, SHUT), 1, "it was sent before");
        assert_eq!(hear(6, 500, SHUT), 1, "it is from an earlier life of the agent");
        assert_eq!(hear(7, 102, "(shut button"), 1, "it cannot be read");
        assert_eq!(hear(7, 103, SHUT), 0);
    }

    #[test]
    fn all_daemons_give_a_press_the_same_identifier() {
        let now = Instant::now();
        let press = || {
            let stops = StopRegistry::default();
            hear(&buttons(false, false), OPEN, &stops, now);
            ids(&stops)
        };
        assert_eq!(press(), press());
        assert_eq!(press()[0].len(), 8);
    }

    #[test]
    fn the_position_of_a_button_is_read_from_repeated_heartbeats_until_it_is_known() {
        let (buttons, stops, now) =
            (buttons(false, false), StopRegistry::default(), Instant::now());
        assert!(buttons.must_read(&agent("button")) && !buttons.must_read(&agent("other")));
        hear(&buttons, SHUT, &stops, now);
        assert!(!buttons.must_read(&agent("button")));
        buttons.miss(&agent("button"), now);
        assert!(buttons.must_read(&agent("button")));
    }
}

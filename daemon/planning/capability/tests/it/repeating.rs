//! Tests that skipping heartbeats that equal the previous one gives the same result as parsing
//! every heartbeat.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::Incarnation;
use capability::{DomainChange, KnownFact, RepeatedHeartbeat};
use proptest::prelude::*;

use crate::office::{Office, effects, facts, id, office, office_of, thermometer, turtlebot};

const AGENTS: [&str; 3] = ["turtlebot-1", "turtlebot-2", "thermometer-1"];

/// The facts of the heartbeats in the tests: about the sending agents themselves or about each
/// other, more or fewer.
const WORDS: [&str; 8] = [
    "",
    "(at turtlebot-1 corridor) (= (speed turtlebot-1) 0.3)",
    "(at turtlebot-1 office2) (= (speed turtlebot-1) 0.7)",
    "(at turtlebot-2 corridor) (= (speed turtlebot-1) 0.9)",
    "(located thermometer-1 office2)",
    "(known-temperature office2)",
    "(unknown (known-temperature office2)) (at turtlebot-1 corridor)",
    "(not (connected corridor office2)) (unknown (at turtlebot-1 office2))",
];

#[derive(Clone, Debug)]
enum Deed {
    /// An agent sends a heartbeat, which usually equals its previous one.
    Beat {
        who: usize,
        word: Option<usize>,
        passes: bool,
    },
    Set(usize, usize),
    Confirm(usize, usize),
    Retract(usize),
    Observe(usize, usize),
    Mask(usize),
    Unmask(usize),
    Remodel(usize),
    Wait(u64),
}

fn deed() -> impl Strategy<Value = Deed> {
    let (who, word) = (0..AGENTS.len(), 0..WORDS.len());
    let said = prop_oneof![3 => Just(None), 1 => word.clone().prop_map(Some)];
    prop_oneof![
        12 => (who.clone(), said, prop::bool::weighted(0.1))
            .prop_map(|(who, word, passes)| Deed::Beat { who, word, passes }),
        1 => (who.clone(), word.clone()).prop_map(|(who, word)| Deed::Set(who, word)),
        1 => (who.clone(), word.clone()).prop_map(|(who, word)| Deed::Confirm(who, word)),
        1 => word.clone().prop_map(Deed::Retract),
        1 => (who.clone(), word).prop_map(|(who, word)| Deed::Observe(who, word)),
        1 => who.clone().prop_map(Deed::Mask),
        1 => who.clone().prop_map(Deed::Unmask),
        1 => who.prop_map(Deed::Remodel),
        4 => (1_u64..3_000).prop_map(Deed::Wait),
    ]
}

/// An office, and whether its maintainer parses every heartbeat.
struct House {
    office: Office,
    reads_all: bool,
    repeated: u32,
}

impl House {
    fn beat(
        &mut self,
        who: &str,
        sequence: u64,
        word: &str,
        is_same: bool,
    ) -> Option<DomainChange> {
        let office = &mut self.office;
        let digest = office.maintainer.agents(office.now);
        let digest = digest.into_iter().find(|view| view.agent == id(who))?.digest;
        let (agent, incarnation, period) = (&id(who), Incarnation(1), Duration::from_secs(1));
        let (digest, before) = (digest.as_str(), sequence - 1);
        let repeated = RepeatedHeartbeat { agent, incarnation, digest, before, sequence, period };
        if is_same && !self.reads_all {
            let change = office.maintainer.believe_repeated(&repeated, office.now);
            if change.is_some() {
                self.repeated += 1;
                return change;
            }
        }
        office.beat(who, (1, sequence), word, "").ok()
    }

    fn other(&mut self, deed: &Deed) -> Option<DomainChange> {
        let now = self.office.now;
        let maintainer = &mut self.office.maintainer;
        match *deed {
            Deed::Beat { .. } => None,
            Deed::Set(who, word) => self.office.set(AGENTS[who], WORDS[word]).ok(),
            Deed::Confirm(who, word) => {
                maintainer.apply_effects(&id(AGENTS[who]), None, &effects(WORDS[word]), now).ok()
            }
            Deed::Retract(word) => Some(maintainer.retract(&facts(WORDS[word]), now)),
            Deed::Observe(who, word) => {
                let seen: Vec<_> = facts(WORDS[word]).into_iter().map(KnownFact::from).collect();
                maintainer.apply_observation(&id(AGENTS[who]), &seen, now).ok()
            }
            Deed::Mask(who) => Some(self.office.mask(AGENTS[who])),
            Deed::Unmask(who) => Some(self.office.unmask(AGENTS[who])),
            Deed::Remodel(who) => {
                let model =
                    model(who).replace("total-cost) 1", "total-cost) 7").replace("0.3", "0.4");
                self.office.admit_life(&model, 1).ok().map(|admission| admission.change)
            }
            Deed::Wait(time) => {
                self.office.now.0 += time;
                Some(self.office.maintainer.expire(self.office.now))
            }
        }
    }
}

fn model(who: usize) -> String {
    match AGENTS[who] {
        name if name.starts_with("turtlebot") => turtlebot(name),
        name => thermometer(name),
    }
}

fn play(deeds: &[Deed], new: impl Fn() -> Office) -> Result<u32, TestCaseError> {
    let house = |reads_all| House {
        office: new().with((0..AGENTS.len()).map(model)),
        reads_all,
        repeated: 0,
    };
    let (mut reading, mut repeating) = (house(true), house(false));
    let mut said: BTreeMap<usize, (u64, usize, bool)> = BTreeMap::new();
    for deed in deeds {
        let changes = match *deed {
            Deed::Beat { who, word, passes } => {
                let (before, last, lasted) = said.get(&who).copied().unwrap_or((0, 0, false));
                let (sequence, word) = (before + 1, word.unwrap_or(last));
                said.insert(who, (sequence, word, !passes));
                if passes {
                    // A heartbeat with facts that expire never counts as a repetition.
                    let beat = |house: &mut House| {
                        house.office.beat(AGENTS[who], (1, sequence), "", WORDS[word]).ok()
                    };
                    [beat(&mut reading), beat(&mut repeating)]
                } else {
                    let is_same = lasted && before > 0 && word == last;
                    [&mut reading, &mut repeating]
                        .map(|house| house.beat(AGENTS[who], sequence, WORDS[word], is_same))
                }
            }
            _ => [&mut reading, &mut repeating].map(|house| house.other(deed)),
        };
        // With a public scope, the revision also counts invisible changes, so it depends on the
        // number of parsed heartbeats.
        let counted = reading.office.eyes.is_none();
        let [read, repeated] = changes.map(|change| {
            let change = change?;
            Some(DomainChange { revision: if counted { change.revision } else { 0 }, ..change })
        });
        prop_assert_eq!(&read, &repeated, "{:?}", deed);
        let now = reading.office.now;
        let (one, other) = (&reading.office.maintainer, &repeating.office.maintainer);
        prop_assert_eq!(one.provenance(now), other.provenance(now), "{:?}", deed);
        prop_assert_eq!(one.agents(now), other.agents(now), "{:?}", deed);
        prop_assert_eq!(reading.office.snapshot().problem, repeating.office.snapshot().problem);
    }
    Ok(repeating.repeated)
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 256, failure_persistence: None, ..ProptestConfig::default()
    })]

    #[test]
    fn skipping_repeated_heartbeats_changes_no_result(
        deeds in prop::collection::vec(deed(), 1..60),
    ) {
        play(&deeds, office)?;
        play(&deeds, || office_of("turtlebot-2"))?;
    }
}

#[test]
fn repeated_heartbeats_are_not_parsed_again() {
    let says = |word| Deed::Beat { who: 0, word, passes: false };
    let quiet: Vec<_> = [says(Some(1))].into_iter().chain((0..9).map(|_| says(None))).collect();
    assert_eq!(play(&quiet, office).expect("no difference"), 9);
    let disturbed = [says(Some(1)), says(None), Deed::Confirm(1, 2), says(None), says(None)];
    assert_eq!(play(&disturbed, office).expect("no difference"), 2, "its claim is newer again");
    let refused = [says(Some(1)), says(None), Deed::Set(1, 2), says(None), says(None)];
    assert_eq!(play(&refused, office).expect("no difference"), 3, "it changes nothing");
}

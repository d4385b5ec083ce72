//! The history under faults: an agent keeps it in whole trials, and every chain of causes that it
//! has ends at a person, a sensor, a clock, or an agent that left or joined.

use std::collections::BTreeMap;

use acl::content::{HistoryKind, HistoryRoot};
use laboratory::play_with_history;

/// Number of seeds. `cargo run --release -p laboratory -- --history --seeds N` plays more.
const SEEDS: u64 = 12;

/// A further seed, in which a cancelled step did not lead to its goal.
const MENDED: u64 = 208;

#[test]
fn every_chain_of_causes_ends_at_a_root() {
    let mut roots: BTreeMap<HistoryRoot, usize> = BTreeMap::new();
    let mut kinds: BTreeMap<HistoryKind, usize> = BTreeMap::new();
    let (mut begun, mut known) = (0, 0);
    for seed in (0..SEEDS).chain([MENDED]) {
        let played = play_with_history(seed).unwrap_or_else(|error| panic!("failed to {error}"));
        assert_eq!(played.broken, [""; 0], "seed {seed}");
        let chains = played.chains.expect("the trial has a history");
        chains.roots.into_iter().for_each(|(root, count)| *roots.entry(root).or_default() += count);
        chains.kinds.into_iter().for_each(|(kind, count)| *kinds.entry(kind).or_default() += count);
        begun += chains.commands[0];
        known += chains.commands[1];
    }
    println!("{roots:?}; {kinds:?}; {known} of {begun} commands are known");
    // A history without events would have no broken chain.
    for kind in [
        HistoryKind::Fact,
        HistoryKind::Goal,
        HistoryKind::Plan,
        HistoryKind::Step,
        HistoryKind::Presence,
    ] {
        assert!(kinds.get(&kind).is_some_and(|count| *count > 0), "{kind}: {kinds:?}");
    }
    for root in [HistoryRoot::Person, HistoryRoot::Sensor, HistoryRoot::Death] {
        assert!(roots.get(&root).is_some_and(|count| *count > 0), "{root}: {roots:?}");
    }
    // Links lose messages, and what is lost on its way to the history as well is not repeated.
    assert!(begun > 0 && known * 20 >= begun * 19, "{known} of {begun} commands are known");
}

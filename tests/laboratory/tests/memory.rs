//! Memory stays bounded: the allocator counts what all agents of a trial hold, while one goal after
//! the other is requested.

use laboratory::endurance::endure;
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATED: PeakAlloc = PeakAlloc;

/// Number of goals after which the caches of ended goals and plans are full.
const FULL_AFTER: usize = 160;

/// Number of goals requested after that; `ALTHING_GOALS` requests more.
const GOALS: usize = 160;

/// Maximum number of bytes that a goal may leave behind in all agents together, while caches with
/// room for thousands of entries are not full yet: the ledgers of actuators, the records of
/// Journals, and the building's own history.
const LEFT_BEHIND_MAX: f64 = 6_144.0;

/// Returns how many bytes each goal leaves behind.
fn left_behind(goals: usize, heard_messages_max: usize) -> f64 {
    let mut held = Vec::new();
    let broken = endure(5, FULL_AFTER + goals, heard_messages_max, |number| {
        if number >= FULL_AFTER {
            held.push(ALLOCATED.current_usage() as f64);
        }
        if number % 100 == 0 {
            println!("after {number} goals: {} KiB", ALLOCATED.current_usage() / 1024);
        }
    });
    let broken = broken.unwrap_or_else(|error| panic!("failed to {error}"));
    assert_eq!(broken, [""; 0]);
    // The median of each half: memory in use goes up and down with every goal.
    let middle = |part: &[f64]| {
        let mut part = part.to_vec();
        part.sort_by(f64::total_cmp);
        part[part.len() / 2]
    };
    let half = held.len() / 2;
    (middle(&held[half..]) - middle(&held[..half])) / half as f64
}

/// One test only, because the allocator counts the whole process.
#[test]
fn memory_stays_bounded_and_a_leak_is_detected() {
    let goals = std::env::var("ALTHING_GOALS").ok().and_then(|goals| goals.parse().ok());
    let bounded = left_behind(goals.unwrap_or(GOALS), 64);
    println!("a goal leaves {bounded:.0} bytes behind");
    assert!(bounded < LEFT_BEHIND_MAX, "a goal leaves {bounded:.0} bytes behind");
    let unbounded = left_behind(GOALS, usize::MAX);
    println!("without a bound on messages remembered: {unbounded:.0} bytes");
    assert!(unbounded > LEFT_BEHIND_MAX, "{unbounded:.0} bytes: a leak would not be noticed");
}

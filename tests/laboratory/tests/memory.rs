//! Memory stays bounded: what all agents of a trial hold, counted by the allocator, while goal after
//! goal is asked for.

use laboratory::endurance::endure;
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATED: PeakAlloc = PeakAlloc;

/// What is remembered by number is full by then: ends of goals and of plans.
const FULL_AFTER: usize = 160;

/// Goals that are asked for after that; `ALTHING_GOALS` asks for more.
const GOALS: usize = 160;

/// What a goal may leave behind in all agents together, in bytes, while what is bounded by thousands is
/// not full yet: what actuators and Journals remember of it on disk too, and the building's own story.
const LEFT_BEHIND_MAX: f64 = 6_144.0;

/// How many bytes each goal leaves behind.
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
    // The middle of each half: what is held goes up and down with every goal.
    let middle = |part: &[f64]| {
        let mut part = part.to_vec();
        part.sort_by(f64::total_cmp);
        part[part.len() / 2]
    };
    let half = held.len() / 2;
    (middle(&held[half..]) - middle(&held[..half])) / half as f64
}

/// One test, because what is counted is the whole process.
#[test]
fn memory_stays_bounded_and_what_has_no_bound_is_noticed() {
    let goals = std::env::var("ALTHING_GOALS").ok().and_then(|goals| goals.parse().ok());
    let bounded = left_behind(goals.unwrap_or(GOALS), 64);
    println!("a goal leaves {bounded:.0} bytes behind");
    assert!(bounded < LEFT_BEHIND_MAX, "a goal leaves {bounded:.0} bytes behind");
    let unbounded = left_behind(GOALS, usize::MAX);
    println!("without a bound on messages remembered: {unbounded:.0} bytes");
    assert!(unbounded > LEFT_BEHIND_MAX, "{unbounded:.0} bytes: a leak would not be noticed");
}

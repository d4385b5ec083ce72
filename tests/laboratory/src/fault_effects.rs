//! Counters of the faults that took effect: a dead process does not crash, and a cut that stops no
//! message has no effect.

use substrate::faulty::MessageCounts;

/// Number of faults that took effect, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultEffects {
    /// Number of faults of messages, by kind.
    pub message_faults: MessageCounts,
    /// Number of processes that died.
    pub crashed: u64,
    /// Number of processes that were started again after a crash.
    pub restarted: u64,
    /// Number of clocks that jumped.
    pub jumped: u64,
    /// Number of faults of the script that took effect, of all kinds.
    pub struck: u64,
}

impl FaultEffects {
    /// Returns each kind with the number of messages or processes that it affected.
    pub fn kinds(&self) -> [(&'static str, u64); 9] {
        let FaultEffects { message_faults: told, crashed, restarted, jumped, struck: _ } = *self;
        let MessageCounts { sent: _, lost, cut, doubled, overtaken, delayed, slowed } = told;
        [
            ("lost", lost),
            ("cut off", cut),
            ("doubled", doubled),
            ("overtaken", overtaken),
            ("delayed", delayed),
            ("slowed", slowed),
            ("crashed", crashed),
            ("restarted", restarted),
            ("clocks jumped", jumped),
        ]
    }
}

/// Returns the number of messages that were affected by bad link conditions so far.
pub fn bad_link_count(told: &MessageCounts) -> u64 {
    let MessageCounts { lost, doubled, overtaken, delayed, .. } = told;
    lost + doubled + overtaken + delayed
}

//! What went wrong in a trial, counted where it takes effect: a process that is dead already does not
//! crash, and a cut that stops no message cuts nothing.

use substrate::faulty::Told;

/// How often which kind of fault took effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effects {
    /// What happened to messages.
    pub told: Told,
    /// Processes that died.
    pub crashed: u64,
    /// Processes that were started after they had died.
    pub restarted: u64,
    /// Clocks that jumped.
    pub jumped: u64,
    /// Faults of the script that took effect, of any kind.
    pub struck: u64,
}

impl Effects {
    /// Each kind, and how many messages or processes it hit.
    pub fn kinds(&self) -> [(&'static str, u64); 9] {
        let Effects { told, crashed, restarted, jumped, struck: _ } = *self;
        let Told { sent: _, lost, cut, doubled, overtaken, delayed, slowed } = told;
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

/// How bad the weather was so far: messages that it has hit.
pub fn stormy(told: &Told) -> u64 {
    let Told { lost, doubled, overtaken, delayed, .. } = told;
    lost + doubled + overtaken + delayed
}

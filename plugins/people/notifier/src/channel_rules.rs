//! The rules of a channel: events that it is for, quiet hours, its rate and its end.

use std::collections::BTreeSet;

use jiff::Timestamp;

use crate::notice::NoticeEvent;
use crate::quiet_hours::QuietHours;

/// The rules by which the notices of a channel wait.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChannelRules {
    /// Events that the channel is for.
    pub(crate) events: BTreeSet<NoticeEvent>,
    pub(crate) quiet: Option<QuietHours>,
    /// Whether stops wait in quiet hours, too.
    pub(crate) are_stops_quiet: bool,
    /// Time from which the channel sends nothing more.
    pub(crate) until: Option<Timestamp>,
    /// Maximum number of sendings in an hour, at least 1.
    pub(crate) per_hour: u32,
}

//! Tests of the whole view: scenarios of messages as they are sent, and random events.

mod messages;
mod random;
mod recording;
mod scenario;

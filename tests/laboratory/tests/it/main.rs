//! Tests of the laboratory, all in virtual time: agents in a house of their own, goals by the clock, and
//! whole ecosystems under faults that a seed decides.

mod house;

mod apart;
mod bids;
mod commitments;
mod copying;
mod deaths;
mod early;
mod ended;
mod executors;
mod forbidden;
mod joint;
mod lost;
mod restored;
mod under_way;

mod due;

mod chains;
mod seeds;
mod together;

//! Joint plans of agents with secrets, without processes: what is announced, that plans hold for a
//! validator that sees everything, and that nothing private is named.

mod confidential;
mod drawn;
mod joint;
mod kinds;
mod parcel;
mod privacy;

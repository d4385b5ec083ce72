//! A client of ONVIF cameras: presets, movement, pictures, addresses of videos and motion events. It
//! knows the twenty operations that these need, and is tolerant of what cameras answer.
//!
//! - [`CameraAccess`] is the address and the login of a camera, [`OnvifCamera`] a connection to it.
//! - [`MotionEvents`] tells whether there is motion, and [`discover`] finds cameras in the network.
//! - [`VideoStream`] is the address of a video with its login; programs record it.
//! - [`PictureServer`] is a program beside a camera, which is asked over HTTP in the same way.
//! - Every wait has a deadline, every answer a bound; no answer causes a panic. Passwords are read
//!   from files, sent as digests or, with HTTP Basic, over TLS only, and never printed.
//! - The host of a camera is always that of the config. Of an address that the camera names, only
//!   the path is used, and the port if the host is the same.
//!
//! This crate knows no agents and no places; `plugins/devices/ptz-camera` does.

mod access;
mod address;
mod camera;
mod clock;
mod digest;
mod discovery;
mod error;
mod events;
mod http;
mod motion;
mod security;
mod server;
mod services;
mod session;
mod soap;
mod stream;
mod tls;
mod xml;

pub use access::CameraAccess;
pub use address::Address;
pub use camera::{
    Abilities, CameraPicture, CameraPreset, OnvifCamera, Position, PtzStatus, StopOnDrop,
};
pub use discovery::{FoundCamera, WS_DISCOVERY, discover};
pub use error::LinkError;
pub use events::MotionEvents;
pub use server::{PictureServer, new_password};
pub use stream::{StreamAccess, VideoStream};

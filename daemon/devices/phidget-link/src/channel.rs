//! Channel of `libphidget22` for one part. A part is a product of Phidgets Inc.

use std::fmt;
use std::time::Duration;

use crate::ffi::{CallError, ChannelHandle};
use crate::library::Library;
use crate::part::PhidgetPart;

/// Place where a part is attached. A field that is `None` matches any value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PartAddress {
    /// Serial number printed on the Phidget, or on the hub that the Phidget is attached to.
    pub serial: Option<i32>,
    /// Number of the port of a VINT hub.
    pub hub_port: Option<u8>,
    /// Number of the input of an interface kit.
    pub port: Option<u8>,
}

impl fmt::Display for PartAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let PartAddress { serial, hub_port, port } = *self;
        if let Some(port) = port {
            write!(f, "port {port} of ")?;
        }
        if let Some(hub_port) = hub_port {
            write!(f, "hub port {hub_port} of ")?;
        }
        match serial {
            Some(serial) => write!(f, "Phidget {serial}"),
            None => f.write_str("any Phidget"),
        }
    }
}

/// Channel of `libphidget22`; closed on drop. The device of the channel may be unplugged and
/// plugged in.
pub struct PhidgetChannel {
    handle: ChannelHandle,
    part: &'static PhidgetPart,
    address: PartAddress,
    /// Error of the first attempt to attach the channel's device in time; `None` once the device
    /// has attached.
    missed: Option<CallError>,
}

impl PhidgetChannel {
    /// Opens a channel, and waits up to `wait` for the channel's device. If the device does not
    /// attach in that time, this is not an error: it may attach later
    /// ([`PhidgetChannel::is_attached`]).
    ///
    /// # Errors
    ///
    /// Returns an error if the library refuses to open the channel.
    pub fn open(
        library: Library,
        part: &'static PhidgetPart,
        address: PartAddress,
        wait: Duration,
    ) -> Result<PhidgetChannel, CallError> {
        let handle = ChannelHandle::create(library.functions, part.class)?;
        let mut channel = PhidgetChannel { handle, part, address, missed: None };
        channel
            .set_address()
            .and_then(|()| channel.open_and_wait(wait))
            .map_err(|e| channel.with_address(e))?;
        Ok(channel)
    }

    fn set_address(&self) -> Result<(), CallError> {
        let PartAddress { serial, hub_port, port } = self.address;
        if let Some(serial) = serial {
            self.handle.set_serial(serial)?;
        }
        if let Some(hub_port) = hub_port {
            self.handle.set_hub_port(i32::from(hub_port))?;
            if self.part.needs_input() && port.is_none() {
                self.handle.set_is_hub_port()?;
            }
        }
        port.map_or(Ok(()), |port| self.handle.set_channel(i32::from(port)))
    }

    fn open_and_wait(&mut self, wait: Duration) -> Result<(), CallError> {
        match self.handle.open_waiting(wait) {
            Err(missed) if missed.is_timeout() => {
                self.missed = Some(missed);
                self.handle.open()
            }
            opened => opened,
        }
    }

    /// Returns `true` if the channel's device is attached.
    pub fn is_attached(&mut self) -> bool {
        let is_attached = self.handle.is_attached();
        if is_attached {
            self.missed = None;
        }
        is_attached
    }

    /// Checks that the channel's device is attached.
    ///
    /// # Errors
    ///
    /// Returns an error with the reason, as far as it is known, if the device is not attached.
    pub fn check_attached(&mut self) -> Result<(), CallError> {
        if self.is_attached() {
            return Ok(());
        }
        let missed = self.missed.clone().unwrap_or_else(CallError::unplugged);
        Err(self.with_address(missed))
    }

    /// Reads the value of the channel, in the quantity's unit.
    ///
    /// # Errors
    ///
    /// Returns an error if the channel's device is not attached, or has no value at present.
    pub fn read(&mut self) -> Result<f64, CallError> {
        self.check_attached()?;
        let value = self.handle.read(self.part.sensor_type);
        value.map(|value| self.part.canonical(value)).map_err(|error| self.with_address(error))
    }

    /// Adds the part and its address to the text of an error: “find it” becomes “find a 1111 at
    /// port 3 of Phidget 12345”.
    fn with_address(&self, mut error: CallError) -> CallError {
        error.what = match error.what.as_str() {
            "find it" => format!("find {} at {}", self.part, self.address),
            "read it" => format!("read {} at {}", self.part, self.address),
            what => format!("{what} (for {} at {})", self.part, self.address),
        };
        error
    }
}

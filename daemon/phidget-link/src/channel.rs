//! One part, opened.

use std::fmt;
use std::time::Duration;

use crate::ffi::{CallError, Handle};
use crate::library::Library;
use crate::part::Part;

/// Where a part hangs. What is not said may be anything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Address {
    /// The number printed on the Phidget, or on the hub it hangs on.
    pub serial: Option<i32>,
    /// The port of a VINT hub.
    pub hub_port: Option<u8>,
    /// The input of an interface kit.
    pub port: Option<u8>,
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Address { serial, hub_port, port } = *self;
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

/// A channel of the library, open as long as this lives. Its device may come and go.
pub struct Channel {
    handle: Handle,
    part: &'static Part,
    address: Address,
    /// Why its device did not come when it was waited for.
    missed: Option<CallError>,
}

impl Channel {
    /// Opens it, and waits so long for its device. One that does not come is no error: it may come
    /// later ([`Channel::is_attached`]).
    ///
    /// # Errors
    ///
    /// If the library refuses.
    pub fn open(
        library: Library,
        part: &'static Part,
        address: Address,
        wait: Duration,
    ) -> Result<Channel, CallError> {
        let handle = Handle::create(library.functions, part.class)?;
        let mut channel = Channel { handle, part, address, missed: None };
        channel.addressed().and_then(|()| channel.opened(wait)).map_err(|e| channel.placed(e))?;
        Ok(channel)
    }

    fn addressed(&self) -> Result<(), CallError> {
        let Address { serial, hub_port, port } = self.address;
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

    fn opened(&mut self, wait: Duration) -> Result<(), CallError> {
        match self.handle.open_waiting(wait) {
            Err(missed) if missed.is_timeout() => {
                self.missed = Some(missed);
                self.handle.open()
            }
            opened => opened,
        }
    }

    /// Whether its device is here.
    pub fn is_attached(&mut self) -> bool {
        let is_attached = self.handle.is_attached();
        if is_attached {
            self.missed = None;
        }
        is_attached
    }

    /// Looks for its device.
    ///
    /// # Errors
    ///
    /// If it is not here, with all that is known of why.
    pub fn seek(&mut self) -> Result<(), CallError> {
        if self.is_attached() {
            return Ok(());
        }
        let missed = self.missed.clone().unwrap_or_else(CallError::unplugged);
        Err(self.placed(missed))
    }

    /// Reads it, in the quantity's unit.
    ///
    /// # Errors
    ///
    /// If its device is not here, or does not know the value (now).
    pub fn read(&mut self) -> Result<f64, CallError> {
        self.seek()?;
        let value = self.handle.read(self.part.sensor_type);
        value.map(|value| self.part.canonical(value)).map_err(|error| self.placed(error))
    }

    /// An error, with what it is about: “find it” becomes “find a 1111 at port 3 of Phidget 12345”.
    fn placed(&self, mut error: CallError) -> CallError {
        error.what = match error.what.as_str() {
            "find it" => format!("find {} at {}", self.part, self.address),
            "read it" => format!("read {} at {}", self.part, self.address),
            what => format!("{what} (for {} at {})", self.part, self.address),
        };
        error
    }
}

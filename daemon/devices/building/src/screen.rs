//! Screens: the text and the channel of each screen, and the resulting texts that are presented in
//! a room.
//!
//! The building allocates a channel to a screen on a wall when the screen is plugged in for the
//! first time. Without a channel the screen shows nothing. The screen keeps its channel until it is
//! removed. A screen on a robot needs no channel.

use std::time::Duration;

use crate::building::Building;
use crate::driver_requests::{DriverAnswer, DriverRequest, ScreenAnswer, ScreenAsk, ScreenState};
use crate::error::{DeviceError, LayoutError};
use crate::handle::BuildingHandle;
use crate::layout::{BuildingDevice, Layout};
use crate::truth::{BuildingEvent, DeviceFault, Truth};

/// Maximum length of the text of a screen, in bytes: enough for a slide. A longer text is refused.
/// A text of this length fits into one line on the socket, even if every character is escaped.
const TEXT_MAX: usize = 1024;

/// Time that a screen takes to light up.
const LIGHTING: Duration = Duration::from_millis(500);

// === impl Layout ===

impl Layout {
    /// Adds a screen on a wall.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if there is no such location.
    pub fn add_screen(&mut self, name: &str, location: &str) -> Result<&mut Layout, LayoutError> {
        let (name, location) = (name.to_owned(), location.to_owned());
        self.add_device(BuildingDevice::Screen { name, location })
    }

    /// Adds a screen that a robot carries.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if there is no such robot.
    pub fn mount_screen(&mut self, name: &str, robot: &str) -> Result<&mut Layout, LayoutError> {
        let (name, carrier) = (name.to_owned(), robot.to_owned());
        self.add_device(BuildingDevice::MountedScreen { name, carrier })
    }
}

// === impl Truth ===

impl Truth {
    /// Returns the channel of a screen; `None` if no channel was allocated.
    pub fn channel_of(&self, screen: &str) -> Option<u32> {
        self.channels.get(screen).copied()
    }

    /// Returns the text that a screen shows; `None` if the screen is dark. A failed screen is dark.
    pub fn shown_on(&self, screen: &str) -> Option<&str> {
        let is_dark = self.fault_of(screen) == Some(DeviceFault::Fails);
        self.shown.get(screen).filter(|_| !is_dark).map(String::as_str)
    }

    /// Returns the texts that are shown in a location, on any screen.
    pub fn presented_in<'a>(&'a self, location: &'a str) -> impl Iterator<Item = &'a str> {
        let here = move |screen: &&String| self.place_of(screen) == Some(location);
        self.shown.keys().filter(here).filter_map(|screen| self.shown_on(screen))
    }

    fn allocate(&mut self, screen: &str) -> Result<u32, DeviceError> {
        self.require_screen(screen)?;
        self.require_unbroken(screen)?;
        if let Some(channel) = self.channel_of(screen) {
            return Ok(channel);
        }
        let is_free = |channel: &u32| !self.channels.values().any(|taken| taken == channel);
        let channel = (1..).find(is_free).expect("invariant: fewer screens than numbers");
        self.channels.insert(screen.to_owned(), channel);
        self.log.record(BuildingEvent::Allocated { screen: screen.to_owned(), channel });
        Ok(channel)
    }

    fn begin_showing(&mut self, screen: &str, text: Option<&str>) -> Result<Duration, DeviceError> {
        self.require_screen(screen)?;
        let slowness = self.begin_use(screen)?;
        let needs_channel =
            matches!(self.layout.device(screen), Some(BuildingDevice::Screen { .. }));
        if needs_channel && self.channel_of(screen).is_none() {
            return Err(DeviceError::NoChannel { device: screen.to_owned() });
        }
        if text.is_some_and(|text| text.len() > TEXT_MAX) {
            return Err(DeviceError::TooLong { device: screen.to_owned(), bytes_max: TEXT_MAX });
        }
        Ok(LIGHTING + slowness)
    }

    fn finish_showing(&mut self, screen: &str, text: Option<&str>) -> Result<(), DeviceError> {
        self.require_unbroken(screen)?;
        let screen = screen.to_owned();
        match text.map(str::to_owned) {
            Some(text) => {
                self.shown.insert(screen.clone(), text.clone());
                self.log.record(BuildingEvent::Shown { screen, text });
            }
            None => {
                if self.shown.remove(&screen).is_some() {
                    self.log.record(BuildingEvent::Darkened { screen });
                }
            }
        }
        Ok(())
    }

    fn require_screen(&self, device: &str) -> Result<(), DeviceError> {
        match self.require_device(device)? {
            BuildingDevice::Screen { .. } | BuildingDevice::MountedScreen { .. } => Ok(()),
            other => Err(crate::world::wrong_kind(other, "screen")),
        }
    }
}

// === impl Building ===

impl Building {
    /// Allocates a channel to a screen, and returns the channel. A screen that has a channel keeps
    /// it.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such screen, or if it has failed.
    pub fn allocate(&self, screen: &str) -> Result<u32, DeviceError> {
        self.change(|truth| truth.allocate(screen))
    }

    /// Shows a text on a screen; `None` turns the screen dark.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such screen, if it has failed or has no channel, or if the
    /// text is too long.
    pub async fn show(&self, screen: &str, text: Option<&str>) -> Result<(), DeviceError> {
        let takes = self.change(|truth| truth.begin_showing(screen, text))?;
        self.work(screen, takes, |truth| truth.finish_showing(screen, text)).await
    }

    /// Returns the state of a screen.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such screen, or if it has failed.
    pub async fn panel(&self, screen: &str) -> Result<ScreenState, DeviceError> {
        let panel = |truth: &mut Truth| {
            truth.require_screen(screen)?;
            truth.require_unbroken(screen)?;
            let text = truth.shown_on(screen).map(str::to_owned);
            Ok(ScreenState { channel: truth.channel_of(screen), text })
        };
        self.work(screen, Duration::ZERO, panel).await
    }

    async fn screen(&self, ask: ScreenAsk) -> Result<ScreenAnswer, DeviceError> {
        match ask {
            ScreenAsk::Allocate { screen } => self.allocate(&screen).map(ScreenAnswer::Channel),
            ScreenAsk::Show { screen, text } => {
                self.show(&screen, text.as_deref()).await.map(|()| ScreenAnswer::Done)
            }
            ScreenAsk::Panel { screen } => self.panel(&screen).await.map(ScreenAnswer::Panel),
        }
    }
}

// === impl BuildingHandle ===

impl BuildingHandle {
    /// Allocates a channel to a screen, and returns the channel; see [`Building::allocate`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::allocate`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn allocate(&self, screen: &str) -> Result<u32, DeviceError> {
        match self.screen(ScreenAsk::Allocate { screen: screen.to_owned() }).await? {
            ScreenAnswer::Channel(channel) => Ok(channel),
            other => Err(DriverAnswer::Screen(other).unexpected()),
        }
    }

    /// Shows a text on a screen; `None` turns the screen dark.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::show`], and if the server of the building
    /// cannot be reached or refuses the request.
    pub async fn show(&self, screen: &str, text: Option<&str>) -> Result<(), DeviceError> {
        let (screen, text) = (screen.to_owned(), text.map(str::to_owned));
        match self.screen(ScreenAsk::Show { screen, text }).await? {
            ScreenAnswer::Done => Ok(()),
            other => Err(DriverAnswer::Screen(other).unexpected()),
        }
    }

    /// Returns the state of a screen; see [`Building::panel`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::panel`], and if the server of the building
    /// cannot be reached or refuses the request.
    pub async fn panel(&self, screen: &str) -> Result<ScreenState, DeviceError> {
        match self.screen(ScreenAsk::Panel { screen: screen.to_owned() }).await? {
            ScreenAnswer::Panel(panel) => Ok(panel),
            other => Err(DriverAnswer::Screen(other).unexpected()),
        }
    }

    pub(crate) async fn screen(&self, ask: ScreenAsk) -> Result<ScreenAnswer, DeviceError> {
        match self.local() {
            Ok(building) => building.screen(ask).await,
            Err(remote) => match remote.ask(DriverRequest::Screen(ask)).await? {
                DriverAnswer::Screen(answer) => Ok(answer),
                other => Err(other.unexpected()),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Building, DeviceFault, Layout};

    #[tokio::test(start_paused = true)]
    async fn a_screen_shows_text_only_with_a_channel_and_until_it_fails() {
        let mut layout = Layout::seeded(0).layout;
        layout.add_screen("screen-1", "conf-room").unwrap();
        layout.mount_screen("screen-2", "turtlebot-1").unwrap();
        let building = Building::new(layout, 1.0).unwrap();
        let presented = |room: &str| -> Vec<String> {
            building.truth().presented_in(room).map(str::to_owned).collect()
        };
        assert!(building.show("screen-1", Some("hello")).await.is_err(), "it has no channel");
        assert_eq!(building.allocate("screen-1").unwrap(), 1);
        assert_eq!(building.allocate("screen-1").unwrap(), 1, "the same again");
        building.show("screen-1", Some("hello")).await.unwrap();
        assert_eq!(presented("conf-room"), ["hello"]);
        building.break_device("screen-1", DeviceFault::Fails).unwrap();
        assert!(presented("conf-room").is_empty());
        assert!(building.panel("screen-1").await.is_err());
        building.show("screen-2", Some("hello")).await.unwrap();
        assert!(presented("conf-room").is_empty(), "the robot is in the corridor");
        building.navigate("turtlebot-1", "conf-room").await.unwrap();
        assert_eq!(presented("conf-room"), ["hello"]);
    }
}

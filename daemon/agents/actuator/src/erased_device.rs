//! Devices of all types behind one trait object, so that the actuator and the agent around it are
//! compiled once, and not once for each type of device.

use std::any::Any;

use acl::content::Refusal;
use substrate::BoxFuture;

use crate::device::{Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact};
use crate::initiative::{Initiative, InitiativeUpdate};

/// Result of a method that has succeeded: a [`Device::Yield`] of the device that ran it.
pub(crate) type ErasedYield = Box<dyn Any + Send>;

/// A [`DeviceEvent`](crate::DeviceEvent) that is applied to a device of the same type.
pub(crate) type ErasedEvent = Box<dyn FnOnce(&mut dyn ErasedDevice) -> Vec<Initiative> + Send>;

/// The methods of [`Device`], without its types.
pub(crate) trait ErasedDevice: Send + 'static {
    fn describe(&self) -> Description;
    fn action_names(&self) -> Vec<String>;
    fn facts(&self) -> Vec<OwnFact>;
    fn read_state(&self) -> Option<BoxFuture<()>>;
    fn check_call(&mut self, call: &MethodCall) -> Option<Refusal>;
    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<ErasedYield, MethodFailure>>;
    fn on_success(&mut self, call: &MethodCall, yielded: ErasedYield) -> MethodResult;
    fn on_failure(&mut self, call: &MethodCall, failure: &MethodFailure);
    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>>;
    fn next_event(&mut self) -> Option<BoxFuture<ErasedEvent>>;
    fn receive_news(&mut self, name: &str, news: &InitiativeUpdate) -> Vec<Initiative>;
    fn makes_bids(&self) -> bool;
    fn as_any(&mut self) -> &mut dyn Any;
}

impl<D: Device> ErasedDevice for D {
    fn describe(&self) -> Description {
        Device::describe(self)
    }

    fn action_names(&self) -> Vec<String> {
        Device::action_names(self)
    }

    fn facts(&self) -> Vec<OwnFact> {
        Device::facts(self)
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        Device::read_state(self)
    }

    fn check_call(&mut self, call: &MethodCall) -> Option<Refusal> {
        Device::check_call(self, call)
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<ErasedYield, MethodFailure>> {
        let performance = Device::perform(self, call);
        Box::pin(async move {
            let yielded = performance.await?;
            let yielded: ErasedYield = Box::new(yielded);
            Ok(yielded)
        })
    }

    fn on_success(&mut self, call: &MethodCall, yielded: ErasedYield) -> MethodResult {
        let yielded = yielded.downcast::<D::Yield>();
        let yielded = yielded.expect("invariant: `perform` of the same device has returned it");
        Device::on_success(self, call, *yielded)
    }

    fn on_failure(&mut self, call: &MethodCall, failure: &MethodFailure) {
        Device::on_failure(self, call, failure);
    }

    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        Device::stand_still(self)
    }

    fn next_event(&mut self) -> Option<BoxFuture<ErasedEvent>> {
        let next = Device::next_event(self)?;
        Some(Box::pin(async move {
            let event = next.await;
            let erased: ErasedEvent = Box::new(|device| {
                let device = device.as_any().downcast_mut::<D>();
                event(device.expect("invariant: an event is applied to its own device"))
            });
            erased
        }))
    }

    fn receive_news(&mut self, name: &str, news: &InitiativeUpdate) -> Vec<Initiative> {
        Device::receive_news(self, name, news)
    }

    fn makes_bids(&self) -> bool {
        Device::makes_bids(self)
    }

    fn as_any(&mut self) -> &mut dyn Any {
        self
    }
}

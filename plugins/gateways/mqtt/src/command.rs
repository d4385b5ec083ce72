//! Commands for a device: what is sent for an action, and when the device counts as having done it.

use std::time::Duration;

use actuator::{BoxFuture, MethodCall, MethodFailure};
use tokio::time::Instant;

use crate::description::OutgoingMessage;
use crate::feature_tracker::{FeatureStatus, FeatureTracker, ObservedValue};
use crate::part::{ClassifiedFeature, DevicePart};
use crate::part_model::{DOWN, LEVEL, OFF, ON, OPTION, SET, UP};
use crate::setting::DeviceSetting;

/// Time limit for the report of a device that was told to stop its movement.
const STOP_REPORT_TIME_MAX: Duration = Duration::from_secs(4);

/// Time limit for a thermostat's report of a new set point. One with a battery sleeps between its
/// messages.
const SET_POINT_TIME_MAX: Duration = Duration::from_secs(60);

/// An action of a device: the messages that are sent, and the values by which it is done.
pub(crate) struct Command {
    pub(crate) feature: usize,
    /// Messages to send, in this order. Without any, the value is only read.
    messages: Vec<OutgoingMessage>,
    /// The commanded values, by feature.
    commanded: Vec<(usize, ObservedValue)>,
    /// The reports that are awaited.
    awaited: Vec<Awaited>,
    within: Duration,
}

/// A report of the device that is awaited: of a feature, and the values that count.
#[derive(Clone, Copy, Debug)]
struct Awaited {
    feature: usize,
    value: AwaitedValue,
}

#[derive(Clone, Copy, Debug)]
enum AwaitedValue {
    Any,
    Exactly(ObservedValue),
    AtLeast(f64),
    AtMost(f64),
}

/// Result of an action: the value that was reported last, and the values that were commanded.
pub(crate) struct DoneCommand {
    pub(crate) feature: usize,
    pub(crate) value: ObservedValue,
    pub(crate) commanded: Vec<(usize, ObservedValue)>,
}

impl AwaitedValue {
    fn fits(self, value: ObservedValue) -> bool {
        match (self, value) {
            (AwaitedValue::Any, _) => true,
            (AwaitedValue::Exactly(wanted), value) => wanted == value,
            (AwaitedValue::AtLeast(least), ObservedValue::Number(number)) => number >= least,
            (AwaitedValue::AtMost(most), ObservedValue::Number(number)) => number <= most,
            _ => false,
        }
    }
}

impl Command {
    /// Returns the command for a call of one of the methods of a feature.
    ///
    /// # Errors
    ///
    /// Returns an error if the method lacks an argument, or its argument is no level or option of
    /// the feature.
    pub(crate) fn of(
        part: &DevicePart,
        feature: usize,
        call: &MethodCall,
    ) -> Result<Command, MethodFailure> {
        let known = &part.features[feature];
        let method = call.method.as_str();
        if let Some(command) = &known.feature.command
            && matches!(method, ON | OFF)
        {
            let is_on = method == ON;
            let message = if is_on { &command.on } else { &command.off };
            return Ok(Command::switching(part, feature, is_on, message.clone()));
        }
        if method.starts_with(SET) || method.starts_with(UP) || method.starts_with(DOWN) {
            return Command::setting(part, feature, call);
        }
        let within = known.class.done_within();
        let (messages, value) = match &known.feature.setting {
            Some(DeviceSetting::Choice(_)) => {
                let name = call.argument(OPTION)?;
                let index = known.options().iter().position(|option| option.name == name);
                let index = index.ok_or_else(|| unknown_value(known, name))?;
                let message = known.options()[index].message.clone();
                (message.into_iter().collect(), Some(ObservedValue::Option(index)))
            }
            Some(DeviceSetting::Trigger(message)) => {
                (vec![message.clone()], Some(ObservedValue::Yes(true)))
            }
            // Any other method measures; the value is requested only if it is unknown.
            _ => (Vec::new(), None),
        };
        let awaited = value.map_or(AwaitedValue::Any, AwaitedValue::Exactly);
        Ok(Command {
            feature,
            messages,
            commanded: value.map(|value| (feature, value)).into_iter().collect(),
            awaited: vec![Awaited { feature, value: awaited }],
            within,
        })
    }

    /// Returns the command that switches a thing. A blind that reports its position is open when it
    /// has reached its highest one.
    fn switching(
        part: &DevicePart,
        switch: usize,
        is_on: bool,
        message: OutgoingMessage,
    ) -> Command {
        let mut commanded = vec![(switch, ObservedValue::Yes(is_on))];
        let mut awaited =
            Awaited { feature: switch, value: AwaitedValue::Exactly(ObservedValue::Yes(is_on)) };
        let level = part.level_of(switch).filter(|level| !part.features[*level].class.remembers);
        if let Some(level) = level
            && let Some(highest) = part.features[level].levels().and_then(|all| all.levels.last())
        {
            let amount = if is_on { highest.amount } else { 0.0 };
            commanded.push((level, ObservedValue::Number(amount)));
            if !part.features[level].feature.states.is_empty() {
                let value = AwaitedValue::Exactly(ObservedValue::Number(amount));
                awaited = Awaited { feature: level, value };
            }
        }
        let within = part.features[switch].class.done_within();
        Command {
            feature: switch,
            messages: vec![message],
            commanded,
            awaited: vec![awaited],
            within,
        }
    }

    /// Returns the command that sets a level, and waits for the measured number of the room that
    /// the level brings about if the method is that of such an action.
    fn setting(
        part: &DevicePart,
        feature: usize,
        call: &MethodCall,
    ) -> Result<Command, MethodFailure> {
        let known = &part.features[feature];
        let name = call.argument(LEVEL)?;
        let levels = known.levels().ok_or_else(|| unknown_value(known, name))?;
        let level = levels.by_name(name).ok_or_else(|| unknown_value(known, name))?;
        let value = ObservedValue::Number(level.amount);
        // The time of a thermostat's class is that for the temperature, not for its set point.
        let is_only_set = known.class.reached().is_some() && call.method.starts_with(SET);
        let mut command = Command {
            feature,
            messages: vec![level.message.clone()],
            commanded: vec![(feature, value)],
            awaited: vec![Awaited { feature, value: AwaitedValue::Exactly(value) }],
            within: if is_only_set { SET_POINT_TIME_MAX } else { known.class.done_within() },
        };
        // A lamp that is off is switched on, too.
        if let Some(switch) = part.switch_of(feature).filter(|_| known.class.remembers) {
            let is_on = ObservedValue::Yes(true);
            let on = part.features[switch].feature.command.as_ref().map(|command| &command.on);
            command.messages.extend(on.filter(|_| !levels.switches_on).cloned());
            command.commanded.push((switch, is_on));
            command.awaited.push(Awaited { feature: switch, value: AwaitedValue::Exactly(is_on) });
        }
        let observed = part.reached_by(feature);
        let reached = match &call.method {
            method if method.starts_with(UP) => Some(AwaitedValue::AtLeast(level.amount)),
            method if method.starts_with(DOWN) => Some(AwaitedValue::AtMost(level.amount)),
            _ => None,
        };
        if let (Some(observed), Some(value)) = (observed, reached) {
            command.awaited.push(Awaited { feature: observed, value });
            // The number that was reached is what people want to know.
            command.feature = observed;
        }
        Ok(command)
    }

    /// Sends the messages, and waits until the device has reported everything that is awaited.
    ///
    /// # Errors
    ///
    /// Returns an error, which completes “failed to …”, if a message cannot be sent, or a report
    /// does not arrive in time.
    pub(crate) async fn carry_out(
        self,
        part: &DevicePart,
        mut hearing: FeatureTracker,
    ) -> Result<DoneCommand, String> {
        for (feature, value) in &self.commanded {
            if let ObservedValue::Number(number) = value {
                hearing.set_commanded(*feature, *number);
            }
        }
        for message in &self.messages {
            hearing.publish(message)?;
        }
        if self.messages.is_empty() {
            hearing.ask(self.feature);
        }
        let until = Instant::now() + self.within;
        let mut value = None;
        for awaited in &self.awaited {
            value = Some(self.wait_for(part, &mut hearing, *awaited, until).await?);
        }
        // For people, the value of the feature counts, and not that of another one.
        let of_feature = self.commanded.iter().find(|(feature, _)| *feature == self.feature);
        let value = of_feature.map(|(_, value)| *value).or(value);
        let value = value.ok_or("find a report to wait for")?;
        Ok(DoneCommand { feature: self.feature, value, commanded: self.commanded })
    }

    async fn wait_for(
        &self,
        part: &DevicePart,
        hearing: &mut FeatureTracker,
        awaited: Awaited,
        until: Instant,
    ) -> Result<ObservedValue, String> {
        let known = &part.features[awaited.feature];
        let Some(source) = known.feature.states.first() else {
            // A device that does not report its state is assumed to be in the last commanded state.
            let commanded = self.commanded.iter().find(|(feature, _)| *feature == awaited.feature);
            let problem = || "learn its state: it reports none".to_owned();
            return commanded.map(|(_, value)| *value).ok_or_else(problem);
        };
        let topic = &source.topic;
        loop {
            let standing = hearing.status(awaited.feature, Instant::now());
            match &standing {
                FeatureStatus::Is(value, _) if awaited.value.fits(*value) => return Ok(*value),
                FeatureStatus::Away(problem) => return Err(problem.clone()),
                _ => (),
            }
            if tokio::time::timeout_at(until, hearing.wait_for_text()).await.is_ok() {
                continue;
            }
            return Err(late(known, topic, awaited.value, &standing));
        }
    }
}

/// Returns the reason why a report did not arrive in time.
fn late(
    known: &ClassifiedFeature,
    topic: &str,
    awaited: AwaitedValue,
    standing: &FeatureStatus,
) -> String {
    let name = &known.name;
    match (awaited, standing) {
        (AwaitedValue::Any, FeatureStatus::NotKnown(Some(reason))) => {
            format!("find the {name} in the message on `{topic}`: {reason}")
        }
        (AwaitedValue::Any, _) => format!("receive a value on `{topic}`: nothing was received yet"),
        (
            _,
            FeatureStatus::Is(value @ (ObservedValue::Number(_) | ObservedValue::Option(_)), _),
        ) => {
            let is = known.words(*value);
            format!("receive a report on `{topic}` that it is done: its {name} is {is}")
        }
        _ => format!("receive a report on `{topic}` that it is done"),
    }
}

fn unknown_value(known: &ClassifiedFeature, name: &str) -> MethodFailure {
    MethodFailure::Driver(format!("set its {} to `{name}`: it has no such value", known.name))
}

/// Returns a future that ends the movement of a device, and waits for a report of the device
/// afterwards; `None` if nothing of the device moves.
pub(crate) fn stand_still(
    part: &DevicePart,
    tracker: &FeatureTracker,
) -> Option<BoxFuture<Result<(), String>>> {
    let moving: Vec<(usize, OutgoingMessage)> = { part.features.iter().enumerate() }
        .filter_map(|(number, known)| Some((number, known.levels()?.stop.clone()?)))
        .collect();
    if moving.is_empty() {
        return None;
    }
    let mut hearing = tracker.clone();
    let features: Vec<usize> = moving.iter().map(|(number, _)| *number).collect();
    let reports = features.iter().any(|number| !part.features[*number].feature.states.is_empty());
    Some(Box::pin(async move {
        let counted = |hearing: &FeatureTracker| -> u64 {
            features.iter().map(|feature| hearing.text_count(*feature)).sum()
        };
        let before = counted(&hearing);
        for (_, stop) in &moving {
            hearing.publish(stop)?;
        }
        if !reports {
            return Err("learn whether it stands still: it reports nothing".to_owned());
        }
        let until = Instant::now() + STOP_REPORT_TIME_MAX;
        while counted(&hearing) == before {
            let waited = tokio::time::timeout_at(until, hearing.wait_for_text()).await;
            waited.map_err(|_| "receive a report that it stands still".to_owned())?;
        }
        Ok(())
    }))
}

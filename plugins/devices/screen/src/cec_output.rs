//! What `cec-ctl`, of Debian's `v4l-utils`, prints about a television, as far as the driver `cec`
//! needs it.

/// What an output says about the television.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct CecOutput {
    /// Place of this machine among the inputs of the television, such as `1.0.0.0`.
    pub(crate) own_address: Option<String>,
    /// Whether this machine has no name on the bus yet, or has lost it.
    pub(crate) is_unconfigured: bool,
    /// Whether the television did not acknowledge a message.
    pub(crate) is_unanswered: bool,
    /// Last state of the power that the television has reported.
    pub(crate) power: Option<Power>,
    /// Place whose picture the television was said to show last.
    pub(crate) shown: Option<String>,
}

/// The power of a television.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Power {
    On,
    TurningOn,
    Standby,
}

/// Place of a machine without a television: nothing is plugged in.
pub(crate) const NO_ADDRESS: &str = "f.f.f.f";

/// Messages by which the bus learns which place is shown, and the field that names the place.
const SHOWS: &[(&str, &str)] = &[
    ("ACTIVE_SOURCE", "phys-addr:"),
    ("ROUTING_CHANGE", "new-phys-addr:"),
    ("ROUTING_INFORMATION", "phys-addr:"),
    ("SET_STREAM_PATH", "phys-addr:"),
];

impl CecOutput {
    /// Reads an output. What is not known is left out.
    pub(crate) fn read(output: &str) -> CecOutput {
        let mut read = CecOutput::default();
        // Name of the message that was received, and whose fields follow.
        let mut received = "";
        for line in output.lines().map(str::trim) {
            if line.starts_with("Transmit from") {
                received = "";
            } else if let Some((_, message)) = line.split_once("Received from") {
                received = message;
                read.hear(message);
            } else if let Some(address) = line.strip_prefix("Physical Address") {
                let address = address.trim_start_matches([' ', ':']);
                read.own_address = Some(address.to_owned());
            } else if let Some((_, state)) = line.split_once("State Change: PA: ") {
                read.own_address = state.split(',').next().map(str::to_owned);
            } else if line.starts_with("Adapter is unconfigured") {
                read.is_unconfigured = true;
            } else if line.contains("Not Acknowledged") {
                read.is_unanswered = true;
            } else if let Some(power) = line.strip_prefix("pwr-state: ") {
                // Other devices of the bus announce their power, too (CEC 2.0).
                if received.is_empty() || received.trim_start().starts_with("TV") {
                    read.power = power_of(power).or(read.power);
                }
            } else {
                read.take_field(received, line);
            }
        }
        read
    }

    /// Takes note of a message without fields.
    fn hear(&mut self, message: &str) {
        if message.trim_start().starts_with("TV to") && message.contains(": STANDBY ") {
            self.power = Some(Power::Standby);
        }
    }

    /// Takes note of a field of a message. A message whose name stands in a line of its own is an
    /// answer, and has only fields of the same names.
    fn take_field(&mut self, received: &str, line: &str) {
        for (message, field) in SHOWS {
            let is_of_message = received.contains(&format!(": {message} "))
                || !received.is_empty() && !received.contains('_');
            if let Some(place) = line.strip_prefix(field).filter(|_| is_of_message) {
                self.shown = Some(place.trim().to_owned());
            }
        }
    }
}

fn power_of(text: &str) -> Option<Power> {
    match text.split(' ').next()? {
        "on" => Some(Power::On),
        "to-on" => Some(Power::TurningOn),
        "standby" | "to-standby" => Some(Power::Standby),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_power_of_another_device_is_not_that_of_the_television() {
        let output = "
    Received from Audio System to all (5 to 15):
    REPORT_POWER_STATUS (0x90):
\tpwr-state: standby (0x01)";
        assert_eq!(CecOutput::read(output).power, None);
        let output = output.replace("Audio System to all (5 to 15)", "TV (0)");
        assert_eq!(CecOutput::read(&output).power, Some(Power::Standby));
    }

    /// Outputs of cec-ctl 1.22 in a real kernel (Debian's 6.1), whose driver `vivid` emulates the
    /// cable, and whose television is `cec-follower`.
    const WATCHED: &str = "
Transmit from Playback Device 1 to TV (4 to 0):
GIVE_DEVICE_POWER_STATUS (0x8f)
    Received from TV (0):
    REPORT_POWER_STATUS (0x90):
\tpwr-state: on (0x00)
\tSequence: 5 Tx Timestamp: 7.298s Rx Timestamp: 7.474s
\tApproximate response time: 104 ms

Transmit from Playback Device 1 to all (4 to 15):
REQUEST_ACTIVE_SOURCE (0x85)
\tSequence: 6 Tx Timestamp: 7.537s Rx Timestamp: 8.544s
\tApproximate response time: 958 ms
\tTx, OK, Rx, Timeout

Initial Event: State Change: PA: 1.0.0.0, LA mask: 0x0010, Conn Info: no
";

    fn watched(rest: &str) -> CecOutput {
        CecOutput::read(&format!("{WATCHED}{rest}"))
    }

    #[test]
    fn the_state_of_a_television_is_read() {
        let on = CecOutput {
            own_address: Some("1.0.0.0".to_owned()),
            power: Some(Power::On),
            ..CecOutput::default()
        };
        assert_eq!(watched(""), on);
        for (message, shown) in [
            (
                "Received from TV to all (0 to 15): ACTIVE_SOURCE (0x82):\n\tphys-addr: 0.0.0.0\n",
                "0.0.0.0",
            ),
            (
                "Received from TV to all (0 to 15): ROUTING_CHANGE (0x80):\n\
                 \torig-phys-addr: 1.0.0.0\n\tnew-phys-addr: 2.0.0.0\n",
                "2.0.0.0",
            ),
            (
                "Received from TV to all (0 to 15): SET_STREAM_PATH (0x86):\n\tphys-addr: 1.0.0.0\n",
                "1.0.0.0",
            ),
        ] {
            let expected = CecOutput { shown: Some(shown.to_owned()), ..on.clone() };
            assert_eq!(watched(message), expected);
        }
        let standby = watched("Received from TV to Playback Device 1 (0 to 4): STANDBY (0x36)\n");
        assert_eq!(standby.power, Some(Power::Standby));
    }

    #[test]
    fn what_this_machine_says_itself_does_not_count() {
        let own = "
Transmit from Playback Device 1 to all (4 to 15):
ACTIVE_SOURCE (0x82):
\tphys-addr: 1.0.0.0
\tSequence: 8 Tx Timestamp: 6.734s
";
        assert_eq!(CecOutput::read(own), CecOutput::default());
    }

    #[test]
    fn an_answer_to_the_question_who_is_shown_is_read() {
        let answer = "
Transmit from Playback Device 1 to all (4 to 15):
REQUEST_ACTIVE_SOURCE (0x85)
    Received from Playback Device 2 (8):
    ACTIVE_SOURCE (0x82):
\tphys-addr: 2.0.0.0
";
        assert_eq!(CecOutput::read(answer).shown.as_deref(), Some("2.0.0.0"));
    }

    #[test]
    fn each_reason_why_there_is_no_television_is_read() {
        let unanswered = "
Transmit from Playback Device 1 to TV (4 to 0):
GIVE_DEVICE_POWER_STATUS (0x8f)
\tSequence: 18 Tx Timestamp: 16.721s
\tTx, Not Acknowledged (4), Max Retries
";
        assert!(CecOutput::read(unanswered).is_unanswered);
        let unconfigured = "\nAdapter is unconfigured, please configure it first.\n";
        assert!(CecOutput::read(unconfigured).is_unconfigured);
        let configured = "
Driver Info:
\tDriver Name                : vivid
\tPhysical Address           : 1.0.0.0
\tLogical Address Mask       : 0x0010
";
        assert_eq!(CecOutput::read(configured).own_address.as_deref(), Some("1.0.0.0"));
        for (state, power) in [
            ("to-on (0x02)", Some(Power::TurningOn)),
            ("standby (0x01)", Some(Power::Standby)),
            ("to-standby (0x03)", Some(Power::Standby)),
            ("melting (0x09)", None),
        ] {
            assert_eq!(CecOutput::read(&format!("\tpwr-state: {state}\n")).power, power);
        }
        assert_eq!(CecOutput::read("garbage: \u{0}\n\tphys-addr: x"), CecOutput::default());
    }
}

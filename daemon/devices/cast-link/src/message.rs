//! The one message of CASTV2 on the wire: a length of four bytes, and a `CastMessage` of Protocol
//! Buffers with seven fields.
//!
//! The message is read and written here and not by a generator of code, because it is one message
//! that has not changed since 2013. Unknown fields are skipped, as Protocol Buffers require.

/// Maximum length of a message, in bytes. It is the limit of the protocol.
pub(crate) const MESSAGE_BYTES_MAX: usize = 64 << 10;

/// Length of the length before a message, in bytes.
pub(crate) const LENGTH_BYTES: usize = 4;

/// Maximum length of a number on the wire, in bytes.
const VARINT_BYTES_MAX: usize = 10;

/// Wire types of Protocol Buffers.
const VARINT: u64 = 0;
const EIGHT_BYTES: u64 = 1;
const BYTES: u64 = 2;
const FOUR_BYTES: u64 = 5;

/// Numbers of the fields of a `CastMessage`.
const PROTOCOL_VERSION: u64 = 1;
const SOURCE: u64 = 2;
const DESTINATION: u64 = 3;
const NAMESPACE: u64 = 4;
const PAYLOAD_TYPE: u64 = 5;
const PAYLOAD_TEXT: u64 = 6;

/// A message to or from a Chromecast. Messages with a binary payload, which only the authentication
/// of devices uses, have an empty text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct CastMessage {
    /// Name of the sender, such as `sender-0`.
    pub(crate) source: String,
    /// Name of the receiver, such as `receiver-0`; `*` means all senders.
    pub(crate) destination: String,
    /// Kind of the message, such as `urn:x-cast:com.google.cast.receiver`.
    pub(crate) namespace: String,
    /// Payload of the message, which is JSON.
    pub(crate) text: String,
}

impl CastMessage {
    /// Returns the message with its length, as it is sent.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut body = Vec::with_capacity(self.text.len() + 128);
        let mut number = |field: u64, value: u64| {
            write_varint(&mut body, field << 3 | VARINT);
            write_varint(&mut body, value);
        };
        // The only version of the protocol, and a payload of text, both have the number 0.
        number(PROTOCOL_VERSION, 0);
        number(PAYLOAD_TYPE, 0);
        for (field, text) in [
            (SOURCE, &self.source),
            (DESTINATION, &self.destination),
            (NAMESPACE, &self.namespace),
            (PAYLOAD_TEXT, &self.text),
        ] {
            write_varint(&mut body, field << 3 | BYTES);
            write_varint(&mut body, text.len() as u64);
            body.extend_from_slice(text.as_bytes());
        }
        // A body that is longer than the length can say is longer than any medium's address.
        let length = u32::try_from(body.len()).unwrap_or(u32::MAX);
        let mut bytes = length.to_be_bytes().to_vec();
        bytes.append(&mut body);
        bytes
    }

    /// Reads the bytes of a message, without its length.
    ///
    /// # Errors
    ///
    /// Returns the reason why the bytes are no message.
    pub(crate) fn decode(bytes: &[u8]) -> Result<CastMessage, String> {
        let mut reader = Reader { rest: bytes };
        let mut message = CastMessage::default();
        while !reader.rest.is_empty() {
            let tag = reader.varint()?;
            match (tag >> 3, tag & 7) {
                (SOURCE, BYTES) => message.source = reader.text()?,
                (DESTINATION, BYTES) => message.destination = reader.text()?,
                (NAMESPACE, BYTES) => message.namespace = reader.text()?,
                (PAYLOAD_TEXT, BYTES) => message.text = reader.text()?,
                (0, _) => return Err("it has a field with the number 0".to_owned()),
                (_, VARINT) => drop(reader.varint()?),
                (_, EIGHT_BYTES) => drop(reader.take(8)?),
                (_, BYTES) => drop(reader.bytes()?),
                (_, FOUR_BYTES) => drop(reader.take(4)?),
                (_, kind) => return Err(format!("it has a field of the unknown kind {kind}")),
            }
        }
        Ok(message)
    }
}

fn write_varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value > 0x7f {
        bytes.push((value & 0x7f) as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// Reads fields of Protocol Buffers, one after the other.
struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            return Err("it ends within a field".to_owned());
        };
        self.rest = rest;
        Ok(taken)
    }

    fn varint(&mut self) -> Result<u64, String> {
        let mut value = 0_u64;
        for index in 0..VARINT_BYTES_MAX {
            let [byte] = self.take(1)? else { break };
            value |= u64::from(byte & 0x7f) << (7 * index);
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err("it has a number that does not end".to_owned())
    }

    fn bytes(&mut self) -> Result<&'a [u8], String> {
        let length = self.varint()?;
        self.take(usize::try_from(length).unwrap_or(usize::MAX))
    }

    fn text(&mut self) -> Result<String, String> {
        let bytes = self.bytes()?.to_vec();
        String::from_utf8(bytes).map_err(|_| "it has a text that is not UTF-8".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ping() -> CastMessage {
        CastMessage {
            source: "sender-0".to_owned(),
            destination: "receiver-0".to_owned(),
            namespace: "urn:x-cast:com.google.cast.tp.heartbeat".to_owned(),
            text: "{\"type\":\"PING\"}".to_owned(),
        }
    }

    #[test]
    fn a_message_is_the_one_that_was_sent() {
        let long = CastMessage { text: "ä".repeat(20_000), ..ping() };
        for message in [ping(), long, CastMessage::default()] {
            let bytes = message.encode();
            let (length, body) = bytes.split_at(LENGTH_BYTES);
            assert_eq!(u32::from_be_bytes(length.try_into().expect("four")), body.len() as u32);
            assert_eq!(CastMessage::decode(body), Ok(message));
        }
    }

    #[test]
    fn unknown_fields_are_skipped() {
        let mut bytes = ping().encode().split_off(LENGTH_BYTES);
        // A payload of bytes (7), a flag (8), and numbers of four and of eight bytes.
        bytes.extend([7 << 3 | 2, 2, 0xff, 0xfe, 8 << 3, 1, 9 << 3 | 5, 1, 2, 3, 4]);
        bytes.extend([10 << 3 | 1, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(CastMessage::decode(&bytes), Ok(ping()));
    }

    #[test]
    fn what_is_no_message_is_an_error() {
        for (bytes, why) in [
            (&[0x12, 5, b'a'][..], "it ends within a field"),
            (&[0x12, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1], "within a field"),
            (&[0xff; 11], "a number that does not end"),
            (&[0x80], "it ends within a field"),
            (&[0x12, 1, 0xff], "not UTF-8"),
            (&[0x13], "the unknown kind 3"),
            (&[0x02, 0], "the number 0"),
        ] {
            let problem = CastMessage::decode(bytes).expect_err(why);
            assert!(problem.contains(why), "{problem}");
        }
    }

    #[test]
    fn bytes_by_chance_and_cut_messages_cause_no_panic() {
        let whole = ping().encode().split_off(LENGTH_BYTES);
        for end in 0..whole.len() {
            let _ = CastMessage::decode(&whole[..end]);
        }
        let mut state = 1_u32;
        for length in 0..512 {
            let byte = |_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as u8
            };
            let bytes: Vec<u8> = (0..length).map(byte).collect();
            let _ = CastMessage::decode(&bytes);
        }
    }
}

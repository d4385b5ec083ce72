//! The frames of the stand-in for a Chromecast, read and written without the client's code.

use serde_json::Value;

/// A message of CASTV2.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    pub(crate) from: String,
    pub(crate) to: String,
    pub(crate) namespace: String,
    pub(crate) text: String,
}

impl Frame {
    pub(crate) fn new(from: &str, to: &str, namespace: &str, payload: &Value) -> Frame {
        let (from, to, namespace) = (from.to_owned(), to.to_owned(), namespace.to_owned());
        Frame { from, to, namespace, text: payload.to_string() }
    }

    /// Returns the frame as it is sent: four bytes of length, then the fields 1 to 6.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut body = vec![0x08, 0];
        for (tag, text) in [(0x12, &self.from), (0x1a, &self.to), (0x22, &self.namespace)] {
            field(&mut body, tag, text);
        }
        body.extend([0x28, 0]);
        field(&mut body, 0x32, &self.text);
        let length = u32::try_from(body.len()).expect("a short message");
        [length.to_be_bytes().to_vec(), body].concat()
    }

    /// Removes the first frame from the received bytes.
    pub(crate) fn take(received: &mut Vec<u8>) -> Option<Frame> {
        let length = u32::from_be_bytes(received.get(..4)?.try_into().expect("four")) as usize;
        let body = received.get(4..4 + length)?.to_vec();
        received.drain(..4 + length);
        let mut texts = std::array::from_fn::<_, 7, _>(|_| String::new());
        let mut rest = body.as_slice();
        while let [tag, tail @ ..] = rest {
            let (value, tail) = number(tail);
            rest = tail;
            if tag & 7 == 2 {
                let (text, tail) = rest.split_at(value);
                let text = String::from_utf8(text.to_vec()).expect("a client sends text");
                texts[usize::from(tag >> 3)] = text;
                rest = tail;
            }
        }
        let [_, _, from, to, namespace, _, text] = texts;
        Some(Frame { from, to, namespace, text })
    }
}

fn field(body: &mut Vec<u8>, tag: u8, text: &str) {
    body.push(tag);
    let mut length = text.len();
    while length >= 0x80 {
        body.push((length % 0x80) as u8 + 0x80);
        length /= 0x80;
    }
    body.push(length as u8);
    body.extend(text.as_bytes());
}

fn number(bytes: &[u8]) -> (usize, &[u8]) {
    let end = bytes.iter().position(|byte| *byte < 0x80).expect("a client sends whole numbers");
    let value =
        bytes[..=end].iter().rev().fold(0, |value, byte| value << 7 | usize::from(byte & 0x7f));
    (value, &bytes[end + 1..])
}

"""Validates the requests of `onvif-link` against the official WSDL and XSD files of ONVIF.

PyPI's `onvif-zeep-async` ships these files; `lxml` validates:

    python3 -m pip install onvif-zeep-async==4.3.0
    python3 tests/peers/onvif/validate.py

The script runs the test of `onvif-link` that writes one request of each kind, and checks each body
strictly. It ends with 1 if a request is invalid, or none was written.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

import onvif
from lxml import etree

ROOT = pathlib.Path(__file__).resolve().parents[3]
WSDL = pathlib.Path(onvif.__file__).parent / "wsdl"
FILES = {
    "http://www.onvif.org/ver10/device/wsdl": "devicemgmt.wsdl",
    "http://www.onvif.org/ver10/media/wsdl": "media.wsdl",
    "http://www.onvif.org/ver20/ptz/wsdl": "ptz.wsdl",
    "http://www.onvif.org/ver10/events/wsdl": "events.wsdl",
    "http://docs.oasis-open.org/wsn/b-2": "b-2.xsd",
}
SCHEMA = "{http://www.w3.org/2001/XMLSchema}schema"
BODY = "{http://www.w3.org/2003/05/soap-envelope}Body"
# Operations that the client knows and the test sends.
EXPECTED = {
    "GetSystemDateAndTime", "GetServices", "GetCapabilities", "GetDeviceInformation",
    "GetProfiles", "GetSnapshotUri", "GetStreamUri", "GetNodes", "GetPresets", "GotoPreset",
    "AbsoluteMove", "ContinuousMove", "Stop", "GetStatus", "CreatePullPointSubscription", "PullMessages",
    "SetSynchronizationPoint", "Unsubscribe",
}


def schema_of(namespace: str) -> etree.XMLSchema:
    """Returns the schema of a service, whose imports are beside its file."""
    path = WSDL / FILES[namespace]
    tree = etree.parse(str(path))
    root = tree.getroot()
    if root.tag == SCHEMA:
        return etree.XMLSchema(tree)
    schema = next(one for one in root.iter(SCHEMA) if one.get("targetNamespace") == namespace)
    # Prefixes of the surrounding file hold inside the schema as well.
    text = etree.tostring(schema)
    return etree.XMLSchema(etree.fromstring(text, base_url=str(path)))


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        test = ["cargo", "test", "-p", "onvif-link", "--test", "stand_in", "every_request"]
        subprocess.run(test, cwd=ROOT, check=True, env={**os.environ, "ONVIF_REQUESTS": folder})
        seen, invalid = set(), 0
        for path in sorted(pathlib.Path(folder).glob("*.xml")):
            request = etree.parse(str(path)).find(BODY)[0]
            name = etree.QName(request)
            schema = schema_of(name.namespace)
            seen.add(name.localname)
            is_valid = schema.validate(request)
            print(f"{'valid  ' if is_valid else 'INVALID'} {name.localname}")
            for error in schema.error_log if not is_valid else []:
                print(f"        {error.message}")
            invalid += not is_valid
        for name in sorted(EXPECTED - seen):
            print(f"MISSING {name}")
        print(f"{len(seen) - invalid} passed, {invalid + len(EXPECTED - seen)} failed")
        return int(invalid > 0 or not EXPECTED <= seen)


if __name__ == "__main__":
    sys.exit(main())

"""Receivers that are not ours, for the tests of the notifier.

    peer.py smtp [CERTIFICATE KEY]   a mail server; prints its port, then each message as JSON
    peer.py webhook SECRET           checks a webhook with the library of Standard Webhooks
    peer.py push                     a browser's keys; decrypts a push message, checks its proof
"""

import base64
import json
import sys


def say(value):
    print(json.dumps(value), flush=True)


def smtp(arguments):
    import asyncio
    import ssl

    from aiosmtpd.smtp import SMTP

    class Handler:
        async def handle_DATA(self, server, session, envelope):
            say({
                "from": envelope.mail_from,
                "to": envelope.rcpt_tos,
                "encrypted": session.ssl is not None,
                "text": envelope.content.decode(),
            })
            return "250 OK"

    options = {}
    if arguments:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(*arguments)
        options = {"tls_context": context, "require_starttls": True}

    async def serve():
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: SMTP(Handler(), **options), "127.0.0.1", 0)
        say({"port": server.sockets[0].getsockname()[1]})
        # The test ends the process; its closed input does, too, if the test has died.
        await loop.run_in_executor(None, sys.stdin.read)
        server.close()

    asyncio.run(serve())


def webhook(arguments):
    from standardwebhooks import Webhook

    request = json.loads(sys.stdin.readline())
    Webhook(arguments[0]).verify(request["body"], request["headers"])
    say({"verified": True})


def decoded(text):
    return base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))


def encoded(data):
    return base64.urlsafe_b64encode(data).decode().rstrip("=")


def push(_):
    import os

    import http_ece
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.hazmat.primitives.asymmetric.utils import encode_dss_signature

    key, auth = ec.generate_private_key(ec.SECP256R1()), os.urandom(16)
    form = (serialization.Encoding.X962, serialization.PublicFormat.UncompressedPoint)
    say({"p256dh": encoded(key.public_key().public_bytes(*form)), "auth": encoded(auth)})
    request = json.loads(sys.stdin.readline())
    body = decoded(request["body"])
    content = http_ece.decrypt(body, private_key=key, auth_secret=auth, version="aes128gcm")
    token, public = request["authorization"].removeprefix("vapid t=").split(", k=")
    signed, signature = token.rsplit(".", 1)
    signature = decoded(signature)
    numbers = [int.from_bytes(part, "big") for part in (signature[:32], signature[32:])]
    public = ec.EllipticCurvePublicKey.from_encoded_point(ec.SECP256R1(), decoded(public))
    public.verify(encode_dss_signature(*numbers), signed.encode(), ec.ECDSA(hashes.SHA256()))
    say({"content": json.loads(content), "claims": json.loads(decoded(signed.split(".")[1]))})


if __name__ == "__main__":
    {"smtp": smtp, "webhook": webhook, "push": push}[sys.argv[1]](sys.argv[2:])

"""Another client of Chromecasts, PyPI's pychromecast: shows a film, and reports what it sees.

Arguments: HOST PORT ADDRESS-OF-A-FILM. Prints one line per observation. With the single argument
`announce NAME PORT` it is a Chromecast that announces itself (zeroconf), until its input ends.
"""

import socket
import sys
import time
import uuid

PATIENCE = 20


def until(what, is_so):
    """Waits until something is so, and prints it."""
    began = time.monotonic()
    while not is_so():
        if time.monotonic() - began > PATIENCE:
            sys.exit(f"{what} is not so")
        time.sleep(0.02)
    print(what, flush=True)


def show(host, port, film):
    import pychromecast
    from pychromecast.models import CastInfo, HostServiceInfo

    services = {HostServiceInfo(host, port)}
    about = CastInfo(services, uuid.uuid4(), "stand-in", "stand-in", host, port, "cast", "Althing")
    cast = pychromecast.Chromecast(about, tries=1, timeout=PATIENCE)
    cast.wait(timeout=PATIENCE)
    until("no app", lambda: cast.app_id is None)
    media = cast.media_controller
    media.play_media(film, "video/mp4")
    media.block_until_active(timeout=PATIENCE)
    until("app CC1AD845", lambda: cast.app_id == "CC1AD845")
    until("playing", lambda: media.status.player_state == "PLAYING")
    until("the film", lambda: media.status.content_id == film)
    cast.set_volume(0.25)
    until("volume 0.25", lambda: cast.status.volume_level == 0.25)
    media.play_media(film + ".missing", "video/mp4")
    until("idle ERROR", lambda: media.status.idle_reason == "ERROR")
    cast.quit_app()
    until("no app again", lambda: cast.app_id is None)
    cast.disconnect(timeout=PATIENCE)


def announce(name, port):
    from zeroconf import ServiceInfo, Zeroconf

    service = "_googlecast._tcp.local."
    properties = {"id": "6c1f00aa", "fn": name, "md": "Chromecast Ultra", "ve": "05", "ca": "4101"}
    info = ServiceInfo(
        service,
        f"Chromecast-Ultra-6c1f00aa.{service}",
        addresses=[socket.inet_aton("127.0.0.1")],
        port=port,
        properties=properties,
        server="6c1f00aa.local.",
    )
    zeroconf = Zeroconf(interfaces=["127.0.0.1"])
    zeroconf.register_service(info)
    print("announced", flush=True)
    sys.stdin.read()
    zeroconf.unregister_service(info)
    zeroconf.close()


if sys.argv[1] == "announce":
    announce(sys.argv[2], int(sys.argv[3]))
else:
    show(sys.argv[1], int(sys.argv[2]), sys.argv[3])

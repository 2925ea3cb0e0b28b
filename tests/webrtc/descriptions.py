"""Session descriptions of other implementations."""

from __future__ import annotations

CHROMIUM = """v=0
o=- 4611731400430051336 2 IN IP4 127.0.0.1
s=-
t=0 0
a=group:BUNDLE 0
a=extmap-allow-mixed
a=msid-semantic: WMS
m=application 9 UDP/DTLS/SCTP webrtc-datachannel
c=IN IP4 0.0.0.0
a=candidate:1467250027 1 udp 2122260223 192.168.0.196 46243 typ host generation 0
a=candidate:435653019 1 tcp 1845501695 192.168.0.196 9 typ host tcptype active generation 0
a=candidate:3 1 udp 2122194687 8d7b2a8f-5a7b-4d7a-9d0c-3f5a9f5f0d4e.local 50001 typ host
a=end-of-candidates
a=ice-ufrag:abcd
a=ice-pwd:asd88fgpdd777uzjYhagZgSomePwd
a=ice-options:trickle
a=fingerprint:sha-256 00:11
a=setup:actpass
a=mid:0
a=sctp-port:5000
a=max-message-size:262144
"""

CANDIDATE = "a=candidate:1 1 udp 1 192.0.2.1 9 typ host\n"

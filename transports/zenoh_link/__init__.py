"""What every dialect on Zenoh needs: sessions, routers, certificates, and threads for handlers.

It knows no keys and no encodings: those are the dialect's (:mod:`transports.zenoh` is this project's own).
"""

"""Pages for a browser, by viser: scenes, decompositions and plans to turn, switch and move things in.

A page is put together from parts: `server.Viewer` is the page itself; layers draw one thing each and have switches of
their own. viser is imported by `server` alone, and only when a page is opened.
"""

"""A page of `raybrook view`, for scripts: talks HTTP as the one in the browser does."""

import http.client
import json


class Page:
    """A page: one connection that acts; another one listens, as browsers have it. `limit`: seconds for an answer."""

    def __init__(self, address, limit):
        self.host, root = address.removeprefix("http://").split("/", 1)
        self.root, self.limit = "/" + root, limit
        self.acting, self.session = self.connect(), None
        self.begin()

    def connect(self):
        return http.client.HTTPConnection(self.host, timeout=self.limit)

    def ask(self, connection, name, body=None):
        connection.request("GET" if body is None else "POST", self.root + name, body)
        answer = connection.getresponse()
        return answer.status, answer.read()

    def begin(self):
        status, body = self.ask(self.acting, "begin", "null")
        if status != 200:
            raise RuntimeError(f"begin: {status}")
        self.session = json.loads(body)["session"]

    def next(self, connection, session, version, frame):
        """The status; what is told after this version and frame, None where nothing is;
        whether a picture is with it.
        """
        status, body = self.ask(connection, f"next?session={session}&version={version}&frame={frame}")
        if status not in (200, 204, 404):
            raise RuntimeError(f"next: {status} {body[:200]}")
        if status != 200:
            return status, None, False
        length = int.from_bytes(body[:4], "big")
        return status, json.loads(body[4 : 4 + length]), len(body) > 4 + length

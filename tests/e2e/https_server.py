# SPDX-License-Identifier: Apache-2.0
"""A server for tests/e2e/update_pull.sh: a folder by HTTPS on loopback, as any web server gives it out, and at a word
one that goes away in the middle.
    https_server.py FOLDER CERTIFICATE KEY CONTROL
CONTROL is a folder: `port` is written there once it listens; a file `cut` holds after how many bytes of a bundle the
connection is closed, once; `log` gets a line for each request: path, first byte asked for."""
import http.server
import os
import ssl
import sys

folder, certificate, key, control = sys.argv[1:]


class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        start = 0
        asked = self.headers.get("Range", "")
        if asked.startswith("bytes=") and asked.endswith("-"):
            start = int(asked[6:-1])
        with open(os.path.join(control, "log"), "a", encoding="ascii") as log:
            log.write(f"{self.path} {start}\n")
        path = os.path.join(folder, os.path.basename(self.path))
        if self.path == "/elsewhere/channel":
            self.send_response(302)
            self.send_header("Location", "/channel")
            self.end_headers()
            return
        if not os.path.isfile(path):
            self.send_error(404)
            return
        with open(path, "rb") as file:
            content = file.read()
        self.send_response(206 if asked else 200)
        if asked:
            self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
        self.send_header("Content-Length", str(len(content) - start))
        self.end_headers()
        cut = os.path.join(control, "cut")
        body = content[start:]
        if path.endswith(".raucb") and os.path.exists(cut):
            with open(cut, encoding="ascii") as file:
                body = body[: int(file.read())]
            os.remove(cut)
        self.wfile.write(body)
        self.close_connection = True

    def log_message(self, *_):
        pass


context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
context.load_cert_chain(certificate, key)


class Server(http.server.ThreadingHTTPServer):
    def finish_request(self, request, client_address):
        # The handshake in the connection's own thread: one that never ends keeps nobody else waiting.
        request.settimeout(60)
        super().finish_request(context.wrap_socket(request, server_side=True), client_address)

    def handle_error(self, request, client_address):
        pass  # a client that does not believe the certificate


server = Server(("127.0.0.1", 0), Handler)
with open(os.path.join(control, "port.new"), "w", encoding="ascii") as file:
    file.write(str(server.server_address[1]))
os.rename(os.path.join(control, "port.new"), os.path.join(control, "port"))
server.serve_forever()

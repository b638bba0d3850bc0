"""The operator's interface of a servo: requests and replies over a socket, and the client."""

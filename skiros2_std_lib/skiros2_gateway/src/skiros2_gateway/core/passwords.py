"""Passwords of users, as salted hashes (scrypt). `python3 -m skiros2_gateway.core.passwords` makes one for the file."""

from __future__ import annotations

import getpass
import hashlib
import hmac
import secrets
import sys

#: A hash in the file of users.
PATTERN = r"^(scrypt:[0-9a-f]{32}:[0-9a-f]{64})?$"
#: The shortest password.
SHORTEST = 10


def hashed(password: str, salt: str = "") -> str:
    """Returns the hash of a password. Takes 50 ms of CPU and 16 MB.

    :param salt: 32 hexadecimal digits; "": random ones.
    """
    salt = salt or secrets.token_hex(16)
    text = password.encode("utf-8", "surrogatepass")
    digest = hashlib.scrypt(text, salt=bytes.fromhex(salt), n=2**14, r=8, p=1, dklen=32)
    return f"scrypt:{salt}:{digest.hex()}"


def is_right(password: str, expected: str) -> bool:
    """Whether a password has a hash; False for the hash "", in the same time."""
    salt = expected.split(":")[1] if expected else ""
    return hmac.compare_digest(hashed(password, salt), expected)


if __name__ == "__main__":
    entered = getpass.getpass("Password: ")
    if len(entered) < SHORTEST:
        raise SystemExit(f"the password is too short, expected at least {SHORTEST} characters")
    sys.stdout.write(f"password: {hashed(entered)}\n")

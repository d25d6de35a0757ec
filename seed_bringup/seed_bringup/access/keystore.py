# SPDX-License-Identifier: Apache-2.0
"""A keystore as SROS 2 lays it out: a certificate authority, and for each enclave a key and what it may do, signed.

Made by the program openssl, for which the ROS packages have no library of their own.
"""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from seed_bringup.access.permissions import YEARS, governance, permissions, utc_now
from seed_bringup.access.policy import Right
from seed_core.errors import FailedError

DAYS = str(365 * YEARS)
CURVE = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")


def make_keystore(folder: Path, rights: Mapping[str, tuple[Right, ...]]) -> None:
    """Make it, or bring it up to date: keys that are there stay, permissions are signed anew.

    Args:
        folder: of the keystore. rights: of each enclave, by its path.

    Raises:
        FailedError: openssl is missing, or failed, or the authority's key is elsewhere.
    """
    if shutil.which("openssl") is None:
        raise FailedError("there is no program openssl, which makes the keys: install openssl")
    public, private, enclaves = folder / "public", folder / "private", folder / "enclaves"
    for place in (public, private, enclaves):
        place.mkdir(parents=True, exist_ok=True)
    private.chmod(0o700)
    certificate, key = public / "ca.cert.pem", private / "ca.key.pem"
    if not certificate.is_file():
        _authority(private, key, certificate)
    elif not key.is_file():  # a new authority would lock out every enclave of the old one
        raise FailedError(f"{key} is missing, which signs for {certificate}: call this where the key is kept")
    for role in ("identity_ca", "permissions_ca"):
        _link(public / f"{role}.cert.pem", certificate)
        _link(private / f"{role}.key.pem", key)
    (enclaves / "governance.xml").write_text(governance(), encoding="utf-8")
    _sign(enclaves / "governance.xml", certificate, key)
    for path, granted in rights.items():
        place = enclaves / path[1:]
        place.mkdir(parents=True, exist_ok=True)
        if not (place / "key.pem").is_file() or not (place / "cert.pem").is_file():
            _identity(place, path, certificate, key)
        for role in ("identity_ca", "permissions_ca"):
            _link(place / f"{role}.cert.pem", certificate)
        _link(place / "governance.p7s", enclaves / "governance.p7s")
        (place / "permissions.xml").write_text(permissions(path, granted, utc_now()), encoding="utf-8")
        _sign(place / "permissions.xml", certificate, key)


def _authority(private: Path, key: Path, certificate: Path) -> None:
    """The authority's key, unless it is there, and its certificate, which comes last: nothing was signed before it."""
    with tempfile.TemporaryDirectory(dir=private) as folder:
        own, signed = Path(folder, "key.pem"), Path(folder, "cert.pem")
        subject = ("-days", DAYS, "-subj", "/CN=sros2CA", "-out", str(signed))
        if key.is_file():
            _openssl("req", "-x509", "-new", "-key", str(key), *subject)
        else:
            _openssl("req", "-x509", *CURVE, "-keyout", str(own), *subject)
            own.chmod(0o600)
            own.replace(key)
        signed.replace(certificate)


def _identity(place: Path, path: str, certificate: Path, key: Path) -> None:
    """Key and certificate of an enclave, both or none."""
    with tempfile.TemporaryDirectory(dir=place) as folder:
        request, own, signed = (Path(folder, name) for name in ("request.pem", "key.pem", "cert.pem"))
        name = path.replace("/", "\\/")
        _openssl("req", "-new", *CURVE, "-keyout", str(own), "-out", str(request), "-subj", f"/CN={name}")
        own.chmod(0o600)
        signed_by = ("-CA", str(certificate), "-CAkey", str(key), "-CAcreateserial", "-CAserial", f"{key}.serial")
        _openssl("x509", "-req", "-in", str(request), *signed_by, "-days", DAYS, "-out", str(signed))
        (place / "cert.pem").unlink(missing_ok=True)  # until the new one is there, the pair is not
        own.replace(place / "key.pem")
        signed.replace(place / "cert.pem")


def _sign(file: Path, certificate: Path, key: Path) -> None:
    signed = ("-out", str(file.with_suffix(".p7s")), "-signer", str(certificate), "-inkey", str(key))
    _openssl("smime", "-sign", "-text", "-in", str(file), *signed)


def _link(link: Path, target: Path) -> None:
    if not link.exists():
        link.symlink_to(os.path.relpath(target, link.parent))


def _openssl(*words: str) -> None:
    done = subprocess.run(["openssl", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise FailedError(f"openssl {words[0]} failed: {done.stderr.strip().splitlines()[-1:]}")

"""Files of networks that a detector's environment needs: fetched once from the npm registry.

They lie beside the environment. A file is taken only with the pinned digest, so that it does not
matter which registry or mirror answers.
"""

from __future__ import annotations

import hashlib
import os
import tarfile
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

from imocap_core.detect.environment import environment_folder
from imocap_core.errors import WorkFailed

REGISTRY = "https://registry.npmjs.org/"  # npm's own default
MOST_BYTES = 200_000_000  # of a package
TIMEOUT_S = 60.0
Announce = Callable[[str], None]


@dataclass(frozen=True)
class NetworkFile:
    """A network's file in a package of the npm registry.

    package: with its scope. version: of the package. member: the file's name in the package.
    sha256, size: of the file. start: where it begins in the member, which ends with it.
    """

    package: str
    version: str
    member: str
    sha256: str
    size: int
    start: int = 0

    @property
    def address(self) -> str:
        """The package's archive, below the registry."""
        return f"{self.package}/-/{self.package.rsplit('/', 1)[-1]}-{self.version}.tgz"

    @property
    def file(self) -> Path:
        """Where it lies, or will."""
        name = f"{self.sha256[:12]}-{Path(self.member).name}"
        return environment_folder() / "models" / name


def fetch_networks(models: Sequence[NetworkFile], announce: Announce) -> None:
    """Fetch those that are missing; `announce` is called before each slow step.

    WorkFailed when a package cannot be fetched or a file is not the pinned one.
    """
    missing = [model for model in models if not is_present(model)]
    for address in dict.fromkeys(model.address for model in missing):
        wanted = [model for model in missing if model.address == address]
        url = registry(wanted[0].package, os.environ).rstrip("/") + "/" + address
        announce(f"fetching {wanted[0].package} {wanted[0].version} (once)")
        folder = wanted[0].file.parent
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=".fetch-", dir=folder) as draft:
                archive = Path(draft) / "package.tgz"
                _download(url, archive)
                for model in wanted:
                    _extract(archive, model, Path(draft) / "model").replace(model.file)
        except (OSError, EOFError, ValueError, tarfile.TarError) as error:
            raise WorkFailed(
                f"cannot fetch {Path(wanted[0].member).name} from {url}: {str(error)[:200]}. "
                "Connect to the network and run `imocap detect --setup` once, name another "
                "registry with npm_config_registry, or choose another detector (detect.detector)"
            ) from None


def is_present(model: NetworkFile) -> bool:
    """Whether the file lies where it should, whole."""
    return model.file.is_file() and model.file.stat().st_size == model.size


def registry(package: str, environment: Mapping[str, str]) -> str:
    """The registry that npm would ask for a package: of npm's variables and the user's .npmrc, the
    scope's before the general one."""
    configured = _npmrc(environment)
    variables = {name.lower(): value for name, value in environment.items()}
    scoped = f"{package.split('/', 1)[0]}:registry"
    general = variables.get("npm_config_registry") or configured.get("registry")
    chosen = configured.get(scoped) or general or REGISTRY
    if not chosen.startswith(("https://", "http://")):
        raise WorkFailed(f"npm's registry: expected an address with https://, got {chosen!r}")
    return chosen


def _npmrc(environment: Mapping[str, str]) -> dict[str, str]:
    """Settings of the user's .npmrc."""
    named = environment.get("NPM_CONFIG_USERCONFIG") or environment.get("npm_config_userconfig")
    file = Path(named) if named else Path.home() / ".npmrc"
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return {}
    pairs = (line.split("=", 1) for line in lines if "=" in line and line.strip()[:1] not in "#;")
    return {name.strip(): value.strip().strip("\"'") for name, value in pairs}


def _download(url: str, file: Path) -> None:
    """The address's content in a file; ValueError when it is larger than any package here."""
    try:
        answer = urlopen(url, timeout=TIMEOUT_S)
    except HTTPError as error:
        error.close()
        raise OSError(str(error)) from None
    with answer, file.open("wb") as out:
        size = 0
        while block := answer.read(1 << 20):
            size += len(block)
            if size > MOST_BYTES:
                raise ValueError(f"it is larger than {MOST_BYTES} bytes")
            out.write(block)


def _extract(archive: Path, model: NetworkFile, file: Path) -> Path:
    """A member of an archive in a file; ValueError when it is not the pinned one."""
    with tarfile.open(archive) as package:
        member = next((m for m in package if m.name == model.member and m.isfile()), None)
        stream = package.extractfile(member) if member else None
        if stream is None:
            raise ValueError(f"{model.member} is not in it")
        stream.seek(model.start)
        content = stream.read(model.size + 1)
    digest = hashlib.sha256(content).hexdigest()
    if digest != model.sha256:
        raise ValueError(f"{model.member}: expected SHA-256 {model.sha256}, got {digest}")
    file.write_bytes(content)
    return file

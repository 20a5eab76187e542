"""Kinematics and composite inertia of a robot at a state: Pinocchio, and sums over the bodies."""

import numpy as np
import pinocchio as pin

Array = np.ndarray
AXES = pin.LOCAL_WORLD_ALIGNED
TURNS = np.array([pin.skew(axis) for axis in np.eye(3)])


class State:
    """Kinematics at zero acceleration of v."""

    def __init__(self, model: pin.Model, q: Array, v: Array) -> None:
        self.model, self.data, self.q, self.v = model, model.createData(), q, v
        pin.forwardKinematics(model, self.data, q, v, np.zeros(model.nv))
        pin.computeJointJacobians(model, self.data, q)
        pin.updateFramePlacements(model, self.data)
        pin.jacobianCenterOfMass(model, self.data, q)
        pin.centerOfMass(model, self.data, q, v, np.zeros(model.nv))
        self.mass = self.data.mass[0]

    def in_base(self) -> "State":
        """The same joints with the base at the origin, at rest: its axes are the world's."""
        q, v = self.q.copy(), self.v.copy()
        q[:7], v[:6] = (0, 0, 0, 0, 0, 0, 1), 0.0
        return State(self.model, q, v)

    def frame(self, k: int) -> tuple[pin.SE3, Array, Array]:
        """Placement, Jacobian (6, nv) and drift (6,), world axes."""
        drift = pin.getFrameClassicalAcceleration(self.model, self.data, k, AXES)
        return self.data.oMf[k], pin.getFrameJacobian(self.model, self.data, k, AXES), drift.vector

    def bodies(self):
        """Mass, second moment about the body's CoM, that CoM c, du/dv, dw/dv, c', c'', w, w'."""
        for j in range(1, self.model.njoints):
            body, place = self.model.inertias[j], self.data.oMi[j]
            arm, R = place.rotation @ body.lever, place.rotation
            J = pin.getJointJacobian(self.model, self.data, j, AXES)
            a = pin.getClassicalAcceleration(self.model, self.data, j, AXES)
            u, w = J[:3] - pin.skew(arm) @ J[3:], J[3:] @ self.v
            lifted = a.linear + np.cross(a.angular, arm) + np.cross(w, np.cross(w, arm))
            S = R @ (0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia) @ R.T
            yield body.mass, S, place.translation + arm, u, J[3:], u @ self.v, lifted, w, a.angular

    def inertia(self) -> tuple[Array, Array, Array]:
        """CRB inertia about the CoM, its derivatives by v (nv, 3, 3), and its second by time.

        I = tr(S) 1 - S with S the sum of S_b + m d d', d from the CoM to the body's.
        """
        nv, data = self.model.nv, self.data
        S, rate, drift = np.zeros((3, 3)), np.zeros((nv, 3, 3)), np.zeros((3, 3))
        for m, own, c, u, turn, dc, ddc, w, dw in self.bodies():
            d, W, moved = c - data.com[0], pin.skew(w), dc - data.vcom[0]
            S += own + m * np.outer(d, d)
            half = np.einsum("kv,kab,bc->vac", turn, TURNS, own)
            half += m * np.einsum("av,b->vab", u - data.Jcom, d)
            rate += half + half.transpose(0, 2, 1)
            half = (pin.skew(dw) + W @ W) @ own + W @ own @ W.T
            half += m * (np.outer(ddc - data.acom[0], d) + np.outer(moved, moved))
            drift += half + half.T
        return tuple(
            np.trace(X, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - X
            for X in (S, rate, drift)
        )

    def inertia_hessian(self, G: Array) -> Array:
        """Second derivative (nv, nv) of <G, I> by v, of both orders the mean.

        A column j that moves column i turns it: d(u_i)/dj = w_j x u_i, d(w_i)/dj = w_j x w_i.
        """
        K, nv = np.trace(G) * np.eye(3) - G, self.model.nv
        joint = [j for j in range(1, self.model.njoints) for _ in range(self.model.nvs[j])]
        above = [set(self.model.supports[j]) for j in joint]
        moved = np.array([[joint[j] in above[i] for j in range(nv)] for i in range(nv)])  # by j
        H = np.zeros((nv, nv))
        for m, S, c, u, w, *_ in self.bodies():
            far, du, A = K @ (c - self.data.com[0]), u - self.data.Jcom, S @ K
            turned = u.T @ pin.skew(far) @ w
            axis = np.array([A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]])
            X = np.einsum("ab,kbc,kv->vac", K, TURNS, w)
            Y = np.einsum("kv,kab,bc->vac", w, TURNS, S)
            H += 2.0 * m * (du.T @ K @ du + np.where(moved, turned, turned.T))
            H += 2.0 * np.where(moved, w.T @ pin.skew(axis) @ w, 0.0)
            H += 2.0 * np.einsum("iab,jba->ij", X, Y + Y.transpose(0, 2, 1))
        return 0.5 * (H + H.T)

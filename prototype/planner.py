"""Prototype of the planner on line: see /work/notes/planner/NOTES.md for the equations."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve

W_A, W_D, W_V, W_Y = 0, 1, 2, 3


@dataclass(frozen=True, kw_only=True)
class Settings:
    knots: int = 24
    h: float = 0.08  # between knots [s]
    every: int = 4  # samples from plan to plan
    margin: float = 0.1
    speed: float = 2.0
    reversal: float = 0.1  # time of a full reversal of torque [s]
    creep: float = 0.5  # of the last plan's way beyond the wall that is allowed
    q: float = 1.0  # of position
    q_v: float = 0.0  # of velocity
    q_d: float = 1e-5  # of changes of a
    rho: tuple = (0.004, 0.0015, 0.015, 0.1)
    soft: tuple = (1.0, 1.0, 1.0, 0.05)  # largest forces of the limits
    iterations: int = 10
    alpha: float = 1.6
    prompt: float = 0.3
    bends: float = 1.0  # for which the reference goes on to bend [s]
    far: float = 2.0
    tail: float = 0.6  # way per speed that is left at the horizon's end [s]


def robot_numbers(robot, controller, settings):
    """Return numbers of the robot: p, offset, B (n,2), limit (n,), J (n,2), viscous, coulomb (n,)."""
    from ballbot.control.lqr import frictionless_model

    f = controller.record[0]["feed_forward"]
    n = robot.wheel_count
    B2, B4 = f["by_second"][:n], f["by_fourth"][:n]
    p = math.sqrt(np.linalg.norm(B2) / np.linalg.norm(B4))
    J = frictionless_model(robot).wheel_jacobian(np.zeros(5))[:, :2]
    fr = robot.friction
    visc = np.broadcast_to(np.asarray(fr.viscous, float), (n,)).copy()
    coul = np.broadcast_to(np.asarray(fr.coulomb, float), (n,)).copy()
    from ballbot.control.controller import grip_torque_limit

    limit = (1.0 - settings.margin) * min(controller.torque_limit, grip_torque_limit(robot)) * np.ones(n)
    return dict(
        p=p, off=float(f["offset"][0, 0]), B=B2.copy(), J=np.ascontiguousarray(J), visc=visc, coul=coul,
        limit=limit, pull=f["pull"].copy(), lean=f["lean"].copy(), C=f["offset"].copy(), kappa=float(f["rolling"]),
        dt=controller.sample_time,
    )


def matrices(num, st, h_0):
    """Return the QP's constant matrices; the unknowns are a_1 .. a_(N-1) of an axis; a_N = 0."""
    p, off, N = num["p"], num["off"], st.knots
    hs = np.full(N, st.h)
    hs[0] = h_0
    # xm_(k+1) = E xm_k + m0 a_k + m1 a_(k+1)
    Es = np.exp(-p * hs)
    m1s = 1.0 - (1.0 - Es) / (p * hs)
    m0s = (1.0 - Es) - m1s

    def response(z0, a):  # z0 = W, w, xm ; a (N+1)
        W, w, xm, xp = (np.zeros(N + 1) for _ in range(4))
        W[0], w[0], xm[0] = z0
        for k in range(N):
            E, m0, m1, h = Es[k], m0s[k], m1s[k], hs[k]
            xm[k + 1] = E * xm[k] + m0 * a[k] + m1 * a[k + 1]
            w[k + 1] = w[k] + 0.5 * h * (a[k] + a[k + 1])
            W[k + 1] = W[k] + h * w[k] + h * h * (a[k] / 3 + a[k + 1] / 6)
        for k in range(N - 1, -1, -1):
            E, m0, m1 = Es[k], m0s[k], m1s[k]
            xp[k] = E * xp[k + 1] + m1 * a[k] + m0 * a[k + 1]
        s2, s3 = 0.5 * (xp + xm), 0.5 * p * (xp - xm)
        return xp[0], w[1:] + s3[1:] / p**2, W[1:] + (1 / p**2 - off) * s2[1:], W[1:] + s2[1:] / p**2

    # of z0 (3), a_0, a_1..a_(N-1)
    cols = []
    for j in range(3 + N):
        z, a = np.zeros(3), np.zeros(N + 1)
        if j < 3:
            z[j] = 1.0
        else:
            a[j - 3] = 1.0
        c, v, y, f = response(z, a)
        cols.append(np.concatenate([[c], v, y, f]))
    R = np.array(cols).T
    c = R[0, 4:].copy()
    c0 = R[0, :4].copy()
    V, Y, F = R[1 : 1 + N], R[1 + N : 1 + 2 * N], R[1 + 2 * N :]
    Y = Y.copy()
    D = np.eye(N)[:, : N - 1] - np.eye(N, k=-1)[:, : N - 1]  # rows a_(k+1) - a_k, k = 0 .. N-1
    D0 = np.zeros((N, 4)); D0[0, 3] = -1.0
    Yw = Y.copy()
    Yw[N - 1] += st.tail * V[N - 1]  # the wall's last row
    n = N - 1
    C = np.vstack([np.eye(n), D, V[:, 4:], Yw[:, 4:]])
    C0 = np.vstack([np.zeros((n, 4)), D0, V[:, :4], Yw[:, :4]])
    groups = np.array([W_A] * n + [W_D] * N + [W_V] * N + [W_Y] * N)
    rho = np.array(st.rho)[groups]
    Gy, Gv = F[:, 4:], V[:, 4:]
    scale = st.h
    P = scale * (st.q * Gy.T @ Gy + st.q_v * Gv.T @ Gv) + st.q_d * D.T @ D
    P0 = scale * (st.q * Gy.T @ F[:, :4] + st.q_v * Gv.T @ V[:, :4]) + st.q_d * D.T @ D0
    Q = scale * st.q * Gy.T  # times -target
    Qv = scale * st.q_v * Gv.T
    K = cho_factor(P + C.T @ (rho[:, None] * C))
    Ki = cho_solve(K, np.eye(n))
    Kc = Ki @ c
    m = Kc / (c @ Kc)
    M = Ki - np.outer(Kc, Kc) / (c @ Kc)
    return dict(c=c, c0=c0, C=C, C0=C0, rho=rho, P0=P0, Q=Q, Qv=Qv, M=M, m=m, V=V, Y=Y)


@njit(cache=True)
def solve(z0, b, target, tvel, wall, d, walled, lo, hi, vmax, dmax, first, B, ca, sa,
          c0, C, C0, rho, P0, Q, Qv, M, m, zz, uu, zw, uw, a, iterations, alpha, soft):
    """ADMM for both axes (2,): z0 (2,4), b = xp_0 (2,), target (N,2); lo, hi (n, N) of wheel torques.

    zz, uu: (rows, 2) of the other limits, zw, uw (N-1, wheels) of the torques, warm started; a (2, N-1). B (wheels, 2)
    is a tight frame: B' B = I.
    """
    n, rows, wheels = a.shape[1], C.shape[0], B.shape[0]
    g0 = np.empty((2, n))
    off = np.empty((rows, 2))
    for j in range(2):
        g0[j] = P0 @ z0[j] - Q @ np.ascontiguousarray(target[:, j]) - Qv @ np.ascontiguousarray(tvel[:, j])
        off[:, j] = C0 @ z0[j]
    bb = np.array([b[0] - c0 @ z0[0], b[1] - c0 @ z0[1]])
    F = np.empty((wheels, 2))
    for w in range(wheels):
        F[w, 0], F[w, 1] = ca * B[w, 0] - sa * B[w, 1], sa * B[w, 0] + ca * B[w, 1]
    worst = 0.0
    r = np.empty(rows)
    cx = np.empty((rows, 2))
    for it in range(iterations):
        for j in range(2):
            for i in range(rows):
                r[i] = rho[i] * (zz[i, j] - uu[i, j] - off[i, j])
            for i in range(n):
                r[i] = 0.0
                for w in range(wheels):
                    r[i] += rho[i] * F[w, j] * (zw[i, w] - uw[i, w])
            a[j] = M @ (C.T @ r - g0[j]) + m * bb[j]
            cx[:, j] = C @ a[j] + off[:, j]
        worst = 0.0
        for i in range(n):
            for w in range(wheels):
                f = F[w, 0] * a[0, i] + F[w, 1] * a[1, i]
                t = alpha * f + (1 - alpha) * zw[i, w] + uw[i, w]
                z = min(max(t, lo[w, i + 1]), hi[w, i + 1])
                most = soft[0] / rho[i]
                z = t - min(max(t - z, -most), most)
                worst = max(worst, abs(z - f))
                uw[i, w], zw[i, w] = t - z, z
        for i in range(n, rows):
            x0, x1 = cx[i, 0], cx[i, 1]
            h0, h1 = alpha * x0 + (1 - alpha) * zz[i, 0], alpha * x1 + (1 - alpha) * zz[i, 1]
            t0, t1 = h0 + uu[i, 0], h1 + uu[i, 1]
            n0, n1, force = t0, t1, soft[1]
            if i < 2 * n + 1:
                s = math.sqrt(t0 * t0 + t1 * t1)
                most = dmax * first if i == n else dmax
                if s > most:
                    n0, n1 = t0 * most / s, t1 * most / s
            elif i < 3 * n + 2:
                s = math.sqrt(t0 * t0 + t1 * t1)
                force = soft[2]
                if s > vmax:
                    n0, n1 = t0 * vmax / s, t1 * vmax / s
            elif walled:
                k = i - (3 * n + 2)
                force = soft[3]
                over = (t0 - wall[k, 0]) * d[0] + (t1 - wall[k, 1]) * d[1]
                if over > 0.0:
                    n0 -= over * d[0]
                    n1 -= over * d[1]
            g = math.sqrt((t0 - n0) ** 2 + (t1 - n1) ** 2) * rho[i]
            if g > force:  # an exact penalty: its force is bounded
                n0, n1 = t0 + force / g * (n0 - t0), t1 + force / g * (n1 - t1)
            uu[i, 0], uu[i, 1] = t0 - n0, t1 - n1
            zz[i, 0], zz[i, 1] = n0, n1
            worst = max(worst, abs(n0 - x0), abs(n1 - x1))
    return worst


class OnLine:
    """Plans on from its own last plan; `step` returns s and four derivatives (5, 2)."""

    def __init__(self, num, st):
        self.num, self.st = num, st
        N = st.knots
        per = round(st.h / num["dt"])
        self.tables = {k: matrices(num, st, st.h - k * num["dt"]) for k in range(0, per, st.every)}
        self.since, self.per = 0, per
        rows = self.tables[0]["C"].shape[0]
        self.zz, self.uu, self.a = np.zeros((rows, 2)), np.zeros((rows, 2)), np.zeros((2, N - 1))
        self.z = np.zeros((2, 4))  # W, w, xm, a_0
        self.xp = np.zeros(2)
        B, lim = num["B"], num["limit"]
        self.amax = float(min(lim) / np.linalg.norm(B, axis=1).max())
        self.dmax = 2.0 * self.amax * st.h / st.reversal
        self.change, self.bend, self.last = np.zeros(2), np.zeros(2), None
        self.fr = (num["visc"], num["coul"], num["J"])
        self.soft = np.array(st.soft) * self.amax / 1.45
        self.size = math.sqrt(float(np.trace(B.T @ B)) / 2.0)  # B / size is a tight frame
        self.zw, self.uw = np.zeros((N - 1, len(B))), np.zeros((N - 1, len(B)))
        self.worst = 0.0

    def motion(self):
        p = self.num["p"]
        W, w, xm, a0 = self.z.T
        s2, s3 = 0.5 * (self.xp + xm), 0.5 * p * (self.xp - xm)
        return np.array([W + s2 / p**2, w + s3 / p**2, s2, s3, p * p * (s2 - a0)])

    def step(self, r, psi=0.0):
        st, num, dt = self.st, self.num, self.num["dt"]
        N = st.knots
        m = self.tables.get(self.since)
        if self.last is None:
            self.last = r.copy()
            self.z[:, 0] = r
            self.zz[3 * N - 1 - 0 :, :] = r
        late = -math.expm1(-dt / 0.046875)
        dr = (r - self.last) / dt
        self.last = r.copy()
        if np.hypot(*dr) > 1.001 * st.speed:
            dr = np.zeros(2)
        nn = dr - self.change
        counts = max(0.0, min(1.0, 2.0 - 2.0 * late * np.hypot(*nn) / dt / (0.35 * self.amax)))
        self.bend = self.bend + late * (counts * late / dt * nn - self.bend)
        self.change = self.change + late * nn
        if m is None:
            return self.advance()
        now = self.change + 0.046875 * self.bend
        speed = np.hypot(*now)
        prompt = max(0.0, min(1.0, (1.5 - max(speed, np.hypot(*self.motion()[1])) / st.prompt) / 0.5))
        t = st.h * np.arange(1, N + 1)[:, None] - dt * self.since
        tb = np.minimum(t, st.bends)
        target = r + prompt * (now * t + self.bend * (tb * t - 0.5 * tb * tb + num["off"] * (t < st.bends)))
        tvel = prompt * (now + self.bend * tb) + 0.0 * t
        s, v = self.motion()[:2]
        away = r - s
        far = np.hypot(*away)
        if far > st.far:
            target = target + (st.far / far - 1.0) * away
        d = away + 0.8 * v
        size = np.hypot(*d)
        walled = prompt < 1.0 and True if speed > st.prompt else size > 0.01
        d = d / size if size > 1e-4 else np.zeros(2)
        wall = r + prompt * (now * t) + d * (0.3 * prompt if speed > 0.02 else 0.0) + 0.0 * t
        yk = m["C"][3 * N - 1 :] @ self.a.T + m["C0"][3 * N - 1 :] @ self.z.T
        ahead = wall @ d; self.dbg = (d.round(2).tolist(), bool(walled), round(float((yk @ d - ahead).max()), 4))
        ahead += st.creep * max(0.0, (yk @ d - ahead).max())  # most of what the last plan needs is allowed
        wall = ahead[:, None] * d
        # wheel friction along the last plan
        ca, sa = math.cos(psi), math.sin(psi)
        vk = np.vstack([v, (m["C"][2 * N - 1 : 3 * N - 1] @ self.a.T) + (m["C0"][2 * N - 1 : 3 * N - 1] @ self.z.T)])
        J = num["J"] @ np.array([[ca, sa], [-sa, ca]])
        w = J @ vk.T
        fric = num["visc"][:, None] * w + num["coul"][:, None] * np.tanh(w / 0.5)
        hi, lo = num["limit"][:, None] - fric, -num["limit"][:, None] - fric
        self.worst = solve(self.z, self.xp, target, tvel, wall, d, walled, lo / self.size, hi / self.size, st.speed, self.dmax, 1.0 - dt * self.since / st.h, num["B"] / self.size, ca, sa,
                           m["c0"], m["C"], m["C0"], m["rho"], m["P0"], m["Q"], m["Qv"], m["M"], m["m"],
                           self.zz, self.uu, self.zw, self.uw, self.a, st.iterations, st.alpha, self.soft)
        return self.advance()

    def advance(self):
        """Return the motion now, and go on by a sample."""
        out = self.motion()
        p, dt = self.num["p"], self.num["dt"]
        W, w, xm, a0 = self.z.T.copy()
        ae = a0 + (self.a[:, 0] - a0) / (self.per - self.since)
        e = math.exp(-p * dt)
        m1 = 1.0 - (1.0 - e) / (p * dt)
        m0 = (1.0 - e) - m1
        self.z[:, 0] = W + dt * w + dt * dt * (a0 / 3 + ae / 6)
        self.z[:, 1] = w + 0.5 * dt * (a0 + ae)
        self.z[:, 2] = e * xm + m0 * a0 + m1 * ae
        self.xp = (self.xp - m1 * a0 - m0 * ae) / e
        self.z[:, 3] = ae
        self.since += 1
        if self.since == self.per:
            self.since = 0
            self.a[:, :-1] = self.a[:, 1:].copy()
            self.a[:, -1] = 0.0
            n = self.st.knots - 1
            for M_ in (self.zz, self.uu):
                for lo_, hi_ in ((0, n), (n, 2 * n + 1), (2 * n + 1, 3 * n + 2), (3 * n + 2, 4 * n + 3)):
                    M_[lo_ : hi_ - 1] = M_[lo_ + 1 : hi_].copy()
            for M_ in (self.zw, self.uw):
                M_[:-1] = M_[1:].copy()
                M_[-1] = 0.0
            self.zz[n - 1] = self.uu[n - 1] = 0.0
            self.zz[2 * n] = self.uu[2 * n] = 0.0
        return out


def rows_of(motions, num, psi=0.0):
    """Return plan rows (k, 10) at heading zero."""
    s, v, s2, s3, _ = np.moveaxis(motions, 1, 0)
    out = np.zeros((len(s), 10))
    p_ = s - s2 @ num["C"].T
    out[:, :2] = p_
    out[:, 5:7] = v - s3 @ num["C"].T
    out[:, 2:4] = s2 @ num["lean"].T
    out[:, 7:9] = s3 @ num["lean"].T
    share = num["kappa"] / np.maximum(np.hypot(out[:, 5], out[:, 6]), 0.01)
    out[:, 2] += -share * out[:, 6]
    out[:, 3] += share * out[:, 5]
    return out


def governed(reference, duration, num, st, planner=None):
    """Return times, plan rows, the poses asked for, and motions."""
    o = OnLine(num, st)
    dt = num["dt"]
    t = dt * np.arange(int(round(duration / dt)) + 1)
    asked = np.array([reference(float(x)) for x in t])
    ms, ws, aa = [], [], []
    for r in asked:
        aa.append(o.z[:, 3].copy())
        ms.append(o.step(r[:2].copy())); ws.append(o.worst)
    return t, rows_of(np.array(ms), num), asked, np.array(ms), np.array(ws), np.array(aa)

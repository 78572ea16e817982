#!/usr/bin/python3
"""The thesis's tracking law (4.7), (4.8) in Python with numpy, like the thesis's own program: measures an
iteration and compares its inputs with ground's.

Reads the output of `controllers --cases`: body, gains, then states, references (p and three derivatives)
and ground's inputs. Prints the time per iteration [s] of each of seven rounds, then the largest
difference of the inputs.
"""
import sys
import time

import numpy as np


def inputs(state, reference, body, gains):
    """Inputs left and right, in 0..1; state is x, y, psi, u, v, r."""
    m, lever, I_z, d, d_r, k = body
    k_e, k_z, k_phi_1, k_phi_2, delta_1, delta_2 = gains
    psi, v, r = state[2], state[3:5], state[5]
    delta, K = np.array([delta_1, delta_2]), np.diag([k_phi_1, k_phi_2])
    c, s = np.cos(psi), np.sin(psi)
    to_body = np.array([[c, s], [-s, c]])
    S = np.array([[0, -r], [r, 0]])
    B = np.array([[1, m * delta_2], [0, -m * delta_1]])
    B_inverse = np.linalg.inv(B)
    e = to_body @ (state[:2] - reference[:2])
    w_d, a_d, j_d = (to_body @ reference[i : i + 2] for i in (2, 4, 6))
    e_dot = -S @ e + v - w_d
    z1 = v - w_d + k_e / m * e
    h = -d * w_d + k_e / m * d * e - m * a_d + k_e * z1 - k_e * k_e / m * e
    alpha = -B_inverse @ (h - d * delta + e / m + K @ (z1 - delta) / m)
    applied = min(max(alpha[0], 0.0), 2 * k)
    v_dot = np.array([applied / m, 0]) - S @ v - d / m * v
    z1_dot = v_dot + S @ w_d - a_d + k_e / m * e_dot
    h_dot = (
        -d * (-S @ w_d + a_d)
        + k_e / m * d * e_dot
        - m * (-S @ a_d + j_d)
        + k_e * z1_dot
        - k_e * k_e / m * e_dot
    )
    alpha_dot = -B_inverse @ (h_dot + e_dot / m + K @ z1_dot / m)
    torque = (
        -m * B[:, 1] @ (z1 - delta) + d_r * alpha[1] + I_z * alpha_dot[1] - k_z * (r - alpha[1])
    )
    wanted = np.array([alpha[0] + torque / lever, alpha[0] - torque / lever]) / (2 * k)
    return np.clip(wanted, 0, 1)


def main():
    rows = [np.array(line.split(","), float) for line in sys.stdin]
    body, gains, cases = rows[0], rows[1], np.array(rows[2:])
    states, references, ours = cases[:, :6], cases[:, 6:14], cases[:, 14:]
    found = np.array([inputs(s, r, body, gains) for s, r in zip(states, references)])
    rounds = []
    for _ in range(7):
        begin = time.perf_counter()
        for state, reference in zip(states, references):
            inputs(state, reference, body, gains)
        rounds.append((time.perf_counter() - begin) / len(states))
    print(" ".join("%.9g" % r for r in rounds))
    print("%.3g" % np.abs(found - ours).max())


if __name__ == "__main__":
    main()

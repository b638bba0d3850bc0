/* The law of benchmarks/sixlaw.py in C. */
#include <math.h>
#include <stdbool.h>

#define N 6
enum { KP, KV, COULOMB, VISCOUS, LIMIT };

double law_calls(const double (*restrict p)[N], double *restrict q, const double *restrict v, double *restrict tau,
                 bool smooth, long n)
{
    double total = 0.0;
    for (long k = 0; k < n; k++) {
        q[k % N] += 1e-4;
        double forearm = 8.4 * cos(q[1] + q[2]) + 1.02 * sin(q[1] + q[2]);
        for (int j = 0; j < N; j++) {
            double v_ref = v[j] + 0.01;
            double share = smooth ? tanh(50.0 * v_ref) : fmin(fmax(50.0 * v_ref, -1.0), 1.0);
            double gravity = j == 1 ? 37.2 * cos(q[1]) + forearm : j == 2 ? forearm : 0.0;
            double torque = p[KP][j] * 0.001 + p[KV][j] * 0.01 + p[VISCOUS][j] * v_ref + p[COULOMB][j] * share
                + gravity - 0.1 * q[j];
            tau[j] = fmin(fmax(torque, -p[LIMIT][j]), p[LIMIT][j]);
            total += tau[j];
        }
    }
    return total;
}

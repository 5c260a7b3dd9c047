/*
 * The floor to measure against: a quadrotor that follows a circle, as plain C.
 *
 * The rigid body (3.3) with the rotor drag (3.13) and the power law of the motors (4.5), classical
 * Runge-Kutta steps, and a geometric controller on SO(3): T. Lee, M. Leok, N. H. McClamroch,
 * "Geometric tracking control of a quadrotor UAV on SE(3)", CDC 2010, with desired rates of zero.
 * Axes: inertial NED, body FRD; quaternion w x y z, body to inertial.
 */

#include <math.h>

typedef struct {
    double mass, inertia[3], gravity, arm, yaw_ratio, power_a, power_b, pwm_min, pwm_max, drag;
} Vehicle;

typedef struct {
    double k_position, k_velocity, k_attitude, k_rate; /* 1/s^2, 1/s, 1/s^2, 1/s */
} Gains;

typedef struct {
    double rho[3], nu[3], q[4], omega[3];
} State;

static void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Rows of the rotation matrix of q, body to inertial. */
static void matrix(const double *q, double R[3][3]) {
    double w = q[0], x = q[1], y = q[2], z = q[3];
    R[0][0] = 1.0 - 2.0 * (y * y + z * z);
    R[0][1] = 2.0 * (x * y - w * z);
    R[0][2] = 2.0 * (x * z + w * y);
    R[1][0] = 2.0 * (x * y + w * z);
    R[1][1] = 1.0 - 2.0 * (x * x + z * z);
    R[1][2] = 2.0 * (y * z - w * x);
    R[2][0] = 2.0 * (x * z - w * y);
    R[2][1] = 2.0 * (y * z + w * x);
    R[2][2] = 1.0 - 2.0 * (x * x + y * y);
}

/* (3.3) under thrust f in N and torque tau in N m. */
static void derivative(const State *s, double f, const double *tau, const Vehicle *v, State *out) {
    double R[3][3], turning[3], spin[3], gyroscopic[3];
    const double *q = s->q, *w = s->omega;
    double k = -0.25 * f * v->drag / v->mass;
    matrix(q, R);
    cross(w, s->nu, turning);
    for (int i = 0; i < 3; i++) {
        out->rho[i] = dot(R[i], s->nu);
        out->nu[i] = v->gravity * R[2][i] - turning[i];
        spin[i] = v->inertia[i] * w[i];
    }
    out->nu[0] += k * s->nu[0];
    out->nu[1] += k * s->nu[1];
    out->nu[2] -= f / v->mass;
    out->q[0] = 0.5 * (-q[1] * w[0] - q[2] * w[1] - q[3] * w[2]);
    out->q[1] = 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1]);
    out->q[2] = 0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2]);
    out->q[3] = 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0]);
    cross(spin, w, gyroscopic);
    for (int i = 0; i < 3; i++)
        out->omega[i] = (gyroscopic[i] + tau[i]) / v->inertia[i];
}

static void add_scaled(const State *a, const State *b, double h, State *out) {
    for (int i = 0; i < 3; i++) {
        out->rho[i] = a->rho[i] + h * b->rho[i];
        out->nu[i] = a->nu[i] + h * b->nu[i];
        out->omega[i] = a->omega[i] + h * b->omega[i];
    }
    for (int i = 0; i < 4; i++)
        out->q[i] = a->q[i] + h * b->q[i];
}

static void step(State *s, double f, const double *tau, double h, const Vehicle *v) {
    State k1, k2, k3, k4, at;
    derivative(s, f, tau, v, &k1);
    add_scaled(s, &k1, 0.5 * h, &at);
    derivative(&at, f, tau, v, &k2);
    add_scaled(s, &k2, 0.5 * h, &at);
    derivative(&at, f, tau, v, &k3);
    add_scaled(s, &k3, h, &at);
    derivative(&at, f, tau, v, &k4);
    add_scaled(s, &k1, h / 6.0, s);
    add_scaled(s, &k2, h / 3.0, s);
    add_scaled(s, &k3, h / 3.0, s);
    add_scaled(s, &k4, h / 6.0, s);
    double *q = s->q, norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; i++)
        q[i] /= norm;
}

/* Commands of the four motors at t on the circle of radius 1 m and rate 1 rad/s. */
static void control(const State *s, double t, double height, const Gains *g, const Vehicle *v,
                    double *pwm) {
    double R[3][3], F[3], c[3] = {0.0, 0.0, 0.0}, x[3], y[3], z[3], tau[3];
    const double *w = s->omega;
    double at[3] = {cos(t), sin(t), -height}, speed[3] = {-sin(t), cos(t), 0.0};
    double acceleration[3] = {-cos(t), -sin(t), -v->gravity};
    matrix(s->q, R);
    for (int i = 0; i < 3; i++)
        F[i] = -v->mass * (acceleration[i] - g->k_position * (s->rho[i] - at[i])
                           - g->k_velocity * (dot(R[i], s->nu) - speed[i]));
    double length = sqrt(dot(F, F)), f = 0.0;
    for (int i = 0; i < 3; i++) {
        f += F[i] * R[i][2];
        z[i] = F[i] / length;
    }
    c[0] = 1.0;
    cross(z, c, y);
    length = sqrt(dot(y, y));
    for (int i = 0; i < 3; i++)
        y[i] /= length;
    cross(y, z, x);
    /* e_R = vee(Rd' R - R' Rd)/2 with the columns x, y, z of Rd */
    double e[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < 3; i++) {
        e[0] += 0.5 * (z[i] * R[i][1] - y[i] * R[i][2]);
        e[1] += 0.5 * (x[i] * R[i][2] - z[i] * R[i][0]);
        e[2] += 0.5 * (y[i] * R[i][0] - x[i] * R[i][1]);
    }
    double spin[3], gyroscopic[3];
    for (int i = 0; i < 3; i++)
        spin[i] = v->inertia[i] * w[i];
    cross(w, spin, gyroscopic);
    for (int i = 0; i < 3; i++)
        tau[i] = v->inertia[i] * (-g->k_attitude * e[i] - g->k_rate * w[i]) + gyroscopic[i];
    double quarter = 0.25 * f, roll = 0.25 * tau[0] / v->arm, pitch = 0.25 * tau[1] / v->arm;
    double yaw = 0.25 * tau[2] / v->yaw_ratio;
    double thrust[4] = {quarter + roll + pitch - yaw, quarter - roll + pitch + yaw,
                        quarter - roll - pitch - yaw, quarter + roll - pitch + yaw};
    for (int i = 0; i < 4; i++) {
        double command = thrust[i] > 0.0 ? pow(thrust[i] / v->power_a, 1.0 / v->power_b) : 0.0;
        pwm[i] = fmin(fmax(command, v->pwm_min), v->pwm_max);
    }
}

/*
 * Fly so many control steps of five steps of the physics each, h s long; the state is that at the
 * end. Where a path is given, its row k of 3 is the position before control step k.
 */
void fly(State *s, long steps, double h, double height, const Gains *g, const Vehicle *v,
         double *path) {
    for (long k = 0; k < steps; k++) {
        double pwm[4], T[4];
        if (path)
            for (int i = 0; i < 3; i++)
                path[3 * k + i] = s->rho[i];
        control(s, 5.0 * h * (double)k, height, g, v, pwm);
        for (int i = 0; i < 4; i++)
            T[i] = v->power_a * pow(pwm[i], v->power_b);
        double tau[3] = {v->arm * (T[0] - T[1] - T[2] + T[3]),
                         v->arm * (T[0] + T[1] - T[2] - T[3]),
                         v->yaw_ratio * (-T[0] + T[1] - T[2] + T[3])};
        for (int i = 0; i < 5; i++)
            step(s, T[0] + T[1] + T[2] + T[3], tau, h, v);
    }
}

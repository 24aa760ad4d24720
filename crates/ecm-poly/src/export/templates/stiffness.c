    /* G = A' [r]x W */
    skew(f.r, t1);
    product(t1, f.w, t2);
    transposed_product(f.a, t2, g);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            cc[3 * i + j] = u[6 * i + j];
            ct[3 * i + j] = u[6 * i + 3 + j];
        }
    }
    /* H_rr = A U_cc A' */
    product(f.a, cc, t1);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            k[6 * i + j] = t1[3 * i] * f.a[3 * j] + t1[3 * i + 1] * f.a[3 * j + 1] +
                           t1[3 * i + 2] * f.a[3 * j + 2];
        }
    }
    /* H_rt = A (U_cc G + U_ct) - [f]x W */
    product(cc, g, cc_g);
    for (int32_t i = 0; i < 9; i++) {
        t1[i] = cc_g[i] + ct[i];
    }
    product(f.a, t1, across);
    skew(h, t1);
    product(t1, f.w, t2);
    for (int32_t i = 0; i < 9; i++) {
        across[i] -= t2[i];
    }
    /* H_tt = U_tt + U_tc G + G' U_ct + G' U_cc G + d2(Q_c . A' r)/dtheta2, less D for K */
    transposed_product(ct, g, mixed);
    transposed_product(g, cc_g, bent);
    form_hessian(&f, force, form);
    torque_derivative(&f, h + 3, d);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            k[6 * i + 3 + j] = across[3 * i + j];
            t1[3 * i + j] = u[6 * (3 + i) + 3 + j] + mixed[3 * i + j] + mixed[3 * j + i] +
                            R(0.5) * (bent[3 * i + j] + bent[3 * j + i]) +
                            R(0.25) * form[3 * i + j] - d[3 * i + j];
        }
    }
    /* Lower rows J^-T (H_tr, H_tt - D) */
    transposed_product(f.inverse, t1, t2);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            k[6 * (3 + i) + 3 + j] = t2[3 * i + j];
            k[6 * (3 + i) + j] = f.inverse[i] * across[3 * j] +
                                 f.inverse[3 + i] * across[3 * j + 1] +
                                 f.inverse[6 + i] * across[3 * j + 2];
        }
    }
/* The smallest of test frameworks: CHECK counts and prints what does not hold, RESULT is main's
 * return value. */
#ifndef LAPD_CHECK_H
#define LAPD_CHECK_H

#include <stdio.h>

static int check_failures;

#define CHECK(condition)                                                                           \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "%s:%d: failed: %s\n", __FILE__, __LINE__, #condition);                \
            check_failures++;                                                                      \
        }                                                                                          \
    } while (0)

#define RESULT (check_failures == 0 ? 0 : 1)

#endif

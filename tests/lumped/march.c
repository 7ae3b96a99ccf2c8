/* A run of one tendon between a given drive and a held end. */
#include <stddef.h>
#include <stdint.h>

#include "lumped.h"

static const double LEAST_PART = 1.0 / 4096.0; /* of a step: twelve halvings */

int64_t march(const Chain *chain, const Imposed *imposed, Records *records, int64_t *passes) {
    int64_t steps = 0, kept = 0;
    Tendon *tendon = tendon_new(chain, imposed);
    if (tendon == NULL) return -1;
    *passes = 0;
    for (int64_t g = 0; g < imposed->times && steps >= 0; g++) {
        tendon_next(tendon, imposed, g);
        double done = 0.0, part = 1.0;
        while (done < 1.0) { /* at most 4096 parts */
            double next = done + part < 1.0 ? done + part : 1.0, span = (next - done) * imposed->span[g];
            int64_t used = tendon_try(tendon, tendon_part(tendon, next), 0.0, span);
            steps++;
            *passes += used < 0 ? -used : used;
            if (used >= 0) {
                tendon_keep(tendon, span);
                done = next;
            } else if ((part *= 0.5) < LEAST_PART) {
                steps = -g - 1;
                break;
            }
        }
        if (steps >= 0 && imposed->keep[g]) tendon_record(tendon, records, kept++);
    }
    tendon_free(tendon);
    return steps;
}

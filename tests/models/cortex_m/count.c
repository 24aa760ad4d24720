/* Instructions and stack of one call. Under `qemu -icount shift=0` an instruction takes 1 ns of virtual
 * time, and SysTick counts it at 25 MHz: 40 instructions a tick. Compile with -DMODEL=name.
 * Prints for h, then for h and K, with -DSTEPS also for a step of 1 ms and one ahead, with -DADAPT for a reading
 * that waits, and for two that make an interval: the least and the most instructions over the golden poses, and
 * the most bytes of stack. */
#include <stdint.h>

#define JOIN2(a, b) a##b
#define JOIN(a, b) JOIN2(a, b)
#include HEADER
#include GOLDEN
#ifdef ADAPT
#include ADAPT
#endif

#define SYSTICK ((volatile uint32_t *)0xE000E010u)

void say(const char *text);

static void number(uint32_t n)
{
    char digits[12];
    int place = 11;
    digits[place] = 0;
    do digits[--place] = (char)('0' + n % 10u); while ((n /= 10u) > 0u);
    say(digits + place);
    say(" ");
}

enum { CALLS = 10, POSES = 16, PAINTED = 8192 };

static JOIN(MODEL, _real) h[6], k[36];
#ifdef STEPS
static JOIN(MODEL, _state) state;
enum { LAST = 4 };
#elif defined ADAPT
static JOIN(MODEL, _adapt_state) state;
static int32_t outcomes[2];
enum { LAST = 4 };

/* A reading of this pose, without noise. */
static int32_t read_one(int pose, JOIN(MODEL, _real) dt)
{
    const JOIN(MODEL, _real) *p = JOIN(MODEL, _golden_p)[pose], *w = JOIN(MODEL, _golden_h)[pose];
    return JOIN(MODEL, _adapt)(&state, 0, p, w, dt, w, JOIN(MODEL, _golden_k)[pose], 0);
}
#else
enum { LAST = 2 };
#endif

static void __attribute__((noinline)) call(int what, int pose)
{
    const JOIN(MODEL, _real) *p = JOIN(MODEL, _golden_p)[pose];
    if (what == 1) JOIN(MODEL, _value)(p, h);
    if (what == 2) JOIN(MODEL, _value_and_stiffness)(p, h, k);
#ifdef STEPS
    if (what == 3) JOIN(MODEL, _step)(&state, p, (JOIN(MODEL, _real))1e-3, 0, h, k);
    if (what == 4) JOIN(MODEL, _predict_ahead)(&state, p, 1, (JOIN(MODEL, _real))1e-3, 0, h, 0);
#endif
#ifdef ADAPT
    static int other;
    if (what == 3) outcomes[0] |= read_one(pose, (JOIN(MODEL, _real))1e-6);
    /* An interval of 0.1 s at poses that change, so that nothing is held for want of a way. */
    if (what == 4) read_one(pose, (JOIN(MODEL, _real))0.04);
    if (what == 4) outcomes[1] = read_one((pose + (other += 5)) % POSES, (JOIN(MODEL, _real))0.07);
#endif
}

static uint32_t ticks(int what, int pose)
{
    SYSTICK[1] = 0xFFFFFFu;
    SYSTICK[2] = 0;
    SYSTICK[0] = 5; /* on, processor clock */
    const uint32_t from = SYSTICK[2];
    for (int i = 0; i < CALLS; i++) call(what, pose);
    return (from - SYSTICK[2]) & 0xFFFFFFu;
}

/* Words below this frame that a call has overwritten. */
static uint32_t __attribute__((noinline)) depth(int what, int pose)
{
    volatile uint32_t *top = (volatile uint32_t *)__builtin_frame_address(0) - 32;
    for (uint32_t i = 0; i < PAINTED; i++) top[-(int32_t)i] = 0xA5A5A5A5u;
    call(what, pose);
    uint32_t used = PAINTED;
    while (used > 0u && top[-(int32_t)used + 1] == 0xA5A5A5A5u) used--;
    return used;
}

int main(void)
{
#ifdef STEPS
    JOIN(MODEL, _init)(&state, JOIN(MODEL, _golden_p)[0]);
#endif
#ifdef ADAPT
    JOIN(MODEL, _adapt_init)(&state, 0);
#endif
    for (int what = 1; what <= LAST; what++) {
        uint32_t least = UINT32_MAX, most = 0, stack = 0;
        for (int pose = 0; pose < POSES; pose++) {
            const uint32_t used = (ticks(what, pose) - ticks(0, pose)) * 40u / CALLS;
            const uint32_t words = depth(what, pose);
            least = used < least ? used : least;
            most = used > most ? used : most;
            stack = words > stack ? words : stack;
        }
        number(least);
        number(most);
        number(4u * stack + 128u);
    }
#ifdef ADAPT
    number((uint32_t)outcomes[0]);
    number((uint32_t)outcomes[1]);
#endif
    say("\n");
    return 0;
}

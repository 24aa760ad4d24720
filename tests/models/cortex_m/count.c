/* Instructions of one call. Under `qemu -icount shift=0` an instruction takes 1 ns of virtual time,
 * and SysTick counts it at 25 MHz: 40 instructions a tick. Compile with -DMODEL=name. */
#include <stdint.h>

#define JOIN2(a, b) a##b
#define JOIN(a, b) JOIN2(a, b)
#define TEXT2(a) #a
#define TEXT(a) TEXT2(a)
#include HEADER
#include GOLDEN

#define SYSTICK ((volatile uint32_t *)0xE000E010u)

void say(const char *text);

static void number(uint32_t n)
{
    char digits[12];
    int place = 11;
    digits[place] = 0;
    do digits[--place] = (char)('0' + n % 10u); while ((n /= 10u) > 0u);
    say(digits + place);
}

enum { CALLS = 400 };

static uint32_t ticks(int what)
{
    JOIN(MODEL, _real) h[6], k[36];
    SYSTICK[1] = 0xFFFFFFu;
    SYSTICK[2] = 0;
    SYSTICK[0] = 5; /* on, processor clock */
    const uint32_t from = SYSTICK[2];
    for (int i = 0; i < CALLS; i++) {
        const JOIN(MODEL, _real) *p = JOIN(MODEL, _golden_p)[i % 16];
        if (what == 1) JOIN(MODEL, _value)(p, h);
        if (what == 2) JOIN(MODEL, _value_and_stiffness)(p, h, k);
        __asm__ volatile("" : : "r"(p), "r"(h), "r"(k) : "memory");
    }
    return (from - SYSTICK[2]) & 0xFFFFFFu;
}

int main(void)
{
    const uint32_t empty = ticks(0), value = ticks(1), both = ticks(2);
    number((value - empty) * 40u / CALLS);
    say(" ");
    number((both - empty) * 40u / CALLS);
    say("\n");
    return 0;
}

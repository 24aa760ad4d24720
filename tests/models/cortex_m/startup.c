/* Reset, floating point on, main, exit code to the host by semihosting. Cortex-M4F and M7, no libc start files. */
#include <stdint.h>

extern uint32_t stack_top, bss_start, bss_end;
int main(void);

static void semihost(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

void say(const char *text);
void say(const char *text) { semihost(0x04, text); }

static void leave(uint32_t code)
{
    const uint32_t block[2] = {0x20026, code}; /* ADP_Stopped_ApplicationExit */
    semihost(0x20, block);
    for (;;) { }
}

void reset(void);
void reset(void)
{
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access to the FPU */
    __asm__ volatile("dsb\n isb");
    for (uint32_t *word = &bss_start; word < &bss_end; word++) *word = 0;
    leave((uint32_t)main());
}

static void fault(void) { leave(99); }

typedef struct {
    const uint32_t *stack;
    void (*handler[15])(void);
} vectors_t;

__attribute__((section(".vectors"), used)) static const vectors_t vectors = {
    &stack_top, {reset, fault, fault, fault, fault, fault}};

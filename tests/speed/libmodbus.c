/* The time of one Modbus transaction with libmodbus alone, and the server that it is asked of.
 *
 * libmodbus-speed serve rtu PATH | libmodbus-speed serve tcp PORT      answers for ever
 * libmodbus-speed ask rtu PATH COUNT PAUSE_US | libmodbus-speed ask tcp PORT COUNT PAUSE_US
 *     reads four registers COUNT times with a pause before each, and prints the median in us
 */
#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static void fail(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, modbus_strerror(errno));
    exit(1);
}

static modbus_t *open_context(const char *framing, const char *place)
{
    int is_rtu = strcmp(framing, "rtu") == 0;
    modbus_t *context = is_rtu ? modbus_new_rtu(place, 115200, 'N', 8, 1)
                               : modbus_new_tcp("127.0.0.1", atoi(place));
    if (context == NULL || modbus_set_slave(context, 1) != 0)
        fail(place);
    return context;
}

static void serve(const char *framing, const char *place)
{
    modbus_t *context = open_context(framing, place);
    modbus_mapping_t *registers = modbus_mapping_new(0, 0, 16, 0);
    uint8_t query[MODBUS_MAX_ADU_LENGTH];
    int is_rtu = strcmp(framing, "rtu") == 0;
    int listener = is_rtu ? -1 : modbus_tcp_listen(context, 1);
    if (is_rtu ? modbus_connect(context) != 0 : listener < 0)
        fail(place);
    for (int i = 0; i < 16; i++)
        registers->tab_registers[i] = 1000 + i;
    printf("listening %s\n", place);
    fflush(stdout);
    for (;;) {
        if (!is_rtu && modbus_tcp_accept(context, &listener) < 0)
            fail("accept");
        for (;;) {
            int length = modbus_receive(context, query);
            if (length > 0)
                modbus_reply(context, query, length, registers);
            else if (length < 0 && !is_rtu)
                break;
        }
        modbus_close(context);
    }
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void ask(const char *framing, const char *place, int count, int pause_us)
{
    modbus_t *context = open_context(framing, place);
    double *took = calloc(count, sizeof *took);
    uint16_t answer[4];
    if (modbus_connect(context) != 0)
        fail(place);
    for (int i = 0; i < count; i++) {
        struct timespec asked, answered;
        if (pause_us > 0)
            usleep(pause_us);
        clock_gettime(CLOCK_MONOTONIC, &asked);
        if (modbus_read_registers(context, 0, 4, answer) != 4)
            fail("read");
        clock_gettime(CLOCK_MONOTONIC, &answered);
        took[i] = 1e6 * (answered.tv_sec - asked.tv_sec) + 1e-3 * (answered.tv_nsec - asked.tv_nsec);
    }
    qsort(took, count, sizeof *took, compare);
    printf("%.1f\n", took[count / 2]);
}

int main(int argc, char **argv)
{
    if (argc == 4 && strcmp(argv[1], "serve") == 0)
        serve(argv[2], argv[3]);
    else if (argc == 6 && strcmp(argv[1], "ask") == 0)
        ask(argv[2], argv[3], atoi(argv[4]), atoi(argv[5]));
    else
        return 2;
    return 0;
}

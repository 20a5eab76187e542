#define _POSIX_C_SOURCE 200112L
#include "udp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <string.h>
#include <sys/socket.h>

/* A packet: head, numbers, CRC-32. The head: wbc1, kind, joints, flags, 0, number, time. */
enum { READING = 1, COMMAND = 2, FLAG = 1, TRUTH = 2, TRUTH_NUMBERS = 13, HEAD = 24, NUMBER = 8, TIME = 16 };
enum { SAID = 4 * WBC_JOINTS + 10, TOLD = 5 * WBC_JOINTS };

static uint32_t crc32(const unsigned char *data, size_t n) {
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < n; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++) crc = crc & 1 ? crc >> 1 ^ 0xEDB88320u : crc >> 1;
    }
    return ~crc;
}

int wbc_udp_open(wbc_udp *bus, const char *robot, int domain) {
    struct sockaddr_in own = {0}, to = {0};
    memset(bus, 0, sizeof *bus);
    own.sin_family = to.sin_family = AF_INET;
    own.sin_port = htons((uint16_t)(WBC_READING_PORT + 2 * domain));
    to.sin_port = htons((uint16_t)(WBC_COMMAND_PORT + 2 * domain));
    own.sin_addr.s_addr = htonl(strncmp(robot, "127.", 4) ? INADDR_ANY : INADDR_LOOPBACK);
    if (inet_pton(AF_INET, robot, &to.sin_addr) != 1) return 0;
    bus->socket = socket(AF_INET, SOCK_DGRAM, 0);
    /* Connected: packets of other senders are not received. */
    return bus->socket >= 0 && fcntl(bus->socket, F_SETFL, O_NONBLOCK) == 0 &&
           bind(bus->socket, (struct sockaddr *)&own, sizeof own) == 0 &&
           connect(bus->socket, (struct sockaddr *)&to, sizeof to) == 0;
}

/* Unpack a reading; 0: the packet is damaged or foreign. */
static int unpack(const unsigned char *packet, size_t size, wbc_reading *r) {
    uint64_t sequence;
    uint32_t crc;
    double numbers[SAID + TRUTH_NUMBERS];
    if (size < HEAD + 4 || memcmp(packet, "wbc1", 4) || packet[4] != READING || packet[5] != WBC_JOINTS) return 0;
    const size_t body = size - 4, count = SAID + (packet[6] & TRUTH ? TRUTH_NUMBERS : 0);
    memcpy(&crc, packet + body, 4);
    if (body != HEAD + 8 * count || crc != crc32(packet, body)) return 0;
    memcpy(&sequence, packet + NUMBER, 8), memcpy(&r->time, packet + TIME, 8);
    memcpy(numbers, packet + HEAD, 8 * count);
    r->sequence = (int64_t)sequence, r->stop = packet[6] & FLAG;
    const double *from = numbers;
    double *const to[] = {r->position, r->velocity, r->torque, r->temperature, r->quaternion, r->rate, r->force};
    const int sizes[] = {WBC_JOINTS, WBC_JOINTS, WBC_JOINTS, WBC_JOINTS, 4, 3, 3};
    for (int k = 0; k < 7; from += sizes[k++]) memcpy(to[k], from, sizes[k] * sizeof *from);
    return 1;
}

int wbc_udp_read(wbc_udp *bus, wbc_reading *reading) {
    unsigned char packet[HEAD + 8 * (SAID + TRUTH_NUMBERS) + 5];
    wbc_reading came;
    int found = 0;
    for (;;) {
        const ssize_t size = recv(bus->socket, packet, sizeof packet, 0);
        if (size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return found;
        if (size < 0) continue; /* refused: nobody is at the other end */
        if (!unpack(packet, (size_t)size, &came)) bus->damaged++;
        else if (!found || came.sequence > reading->sequence) *reading = came, found = 1;
    }
}

int wbc_udp_write(wbc_udp *bus, const wbc_motors *c, uint64_t sequence) {
    unsigned char packet[HEAD + 8 * TOLD + 4] = {'w', 'b', 'c', '1', COMMAND, WBC_JOINTS};
    const double *const from[] = {c->position, c->velocity, c->torque, c->kp, c->kd};
    packet[6] = c->enabled ? FLAG : 0;
    memcpy(packet + NUMBER, &sequence, 8);
    for (int k = 0; k < 5; k++) memcpy(packet + HEAD + 8 * WBC_JOINTS * k, from[k], 8 * WBC_JOINTS);
    const uint32_t crc = crc32(packet, HEAD + 8 * TOLD);
    memcpy(packet + HEAD + 8 * TOLD, &crc, 4);
    if (send(bus->socket, packet, sizeof packet, 0) == (ssize_t)sizeof packet) return 1;
    /* Nobody listens yet, or the buffer is full and the next one is newer anyway: no error. */
    return errno == EAGAIN || errno == EWOULDBLOCK || errno == ECONNREFUSED;
}

/* The bus over UDP, as in wbc/hardware/udp.py: readings arrive at one port, commands go to another. Numbers are
 * little-endian, as on all supported machines. */
#ifndef WBC_UDP_H
#define WBC_UDP_H

#include "safety.h"

typedef struct {
    int socket;
    int64_t damaged;
} wbc_udp;

/* Open the controller's end to the robot at an address; domain: offset of the ports. 0: failed. */
int wbc_udp_open(wbc_udp *bus, const char *robot, int domain);
/* Read the newest reading since the last call; 0: none came. Never blocks. */
int wbc_udp_read(wbc_udp *bus, wbc_reading *reading);
/* Send a command with its number; 0: the system refuses. Never blocks. */
int wbc_udp_write(wbc_udp *bus, const wbc_motors *command, uint64_t sequence);

#endif

/* The bus over UDP, as wbc/hardware/udp.py has it: readings come to one port, commands go to another.
 * Numbers are little-endian, as on all machines that this was compiled for. */
#ifndef WBC_UDP_H
#define WBC_UDP_H

#include "safety.h"

typedef struct {
    int socket;
    int64_t damaged;
} wbc_udp;

/* Open the controller's end to the robot at an address; domain: moves the ports. 0: it cannot be. */
int wbc_udp_open(wbc_udp *bus, const char *robot, int domain);
/* Read the newest reading since the last call; 0: none came. It never waits. */
int wbc_udp_read(wbc_udp *bus, wbc_reading *reading);
/* Send a command with a number; 0: the system refuses it. It never waits. */
int wbc_udp_write(wbc_udp *bus, const wbc_motors *command, uint64_t sequence);

#endif

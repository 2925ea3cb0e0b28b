/* Participant of DDS that announces no type hashes, and has the messages of Humble: it publishes a range, and prints the
   strings that it receives. Usage: participant DOMAIN */

#include "Types.h"
#include "dds/dds.h"
#include <stdio.h>
#include <stdlib.h>

int main(int count, char **words) {
  if (count != 2) return 2;
  dds_entity_t participant = dds_create_participant((dds_domainid_t)atoi(words[1]), NULL, NULL);
  dds_qos_t *qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  dds_entity_t out =
      dds_create_topic(participant, &sensor_msgs_msg_dds__Range__desc, "rt/range", NULL, NULL);
  dds_entity_t in = dds_create_topic(participant, &std_msgs_msg_dds__String__desc, "rt/words", NULL, NULL);
  dds_entity_t writer = dds_create_writer(participant, out, qos, NULL);
  dds_entity_t reader = dds_create_reader(participant, in, qos, NULL);
  sensor_msgs_msg_dds__Range_ range = {{{1, 2}, "sonar"}, 0, 0.5f, 0.25f, 4.0f, 1.5f};
  for (;;) {
    void *samples[1] = {NULL};
    dds_sample_info_t infos[1];
    dds_write(writer, &range);
    int taken = dds_take(reader, samples, infos, 1, 1);
    if (taken > 0 && infos[0].valid_data) {
      printf("%s\n", ((std_msgs_msg_dds__String_ *)samples[0])->data);
      fflush(stdout);
    }
    if (taken > 0) dds_return_loan(reader, samples, taken);
    dds_sleepfor(DDS_MSECS(50));
  }
}
